/* An ATmega328P as far as GRBL uses it, for the host's compiler; included before every file of GRBL.
   Registers are variables (-fcommon); board.c reads and writes them as the hardware does. */
#include <stdint.h>

#define F_CPU 16000000
#define __flash
#define PSTR(text) (text)
#define pgm_read_byte_near(at) (*(at))
#define ISR(vector) void on_##vector(void)
#define sei() (SREG |= 0x80)
#define cli() (SREG &= 0x7f)
#define _delay_ms(ms) board_wait(16000ull * (ms))
#define _delay_us(us) board_wait(16ull * (us))
void board_wait(uint64_t ticks);

volatile uint8_t SREG, PORTB, PORTC, PORTD, DDRB, DDRC, DDRD, PINB, PINC, PIND, PCICR, PCMSK0, PCMSK1, PCMSK2;
volatile uint8_t TIMSK0, TIMSK1, TIMSK2, TCCR0A, TCCR0B, TCCR1A, TCCR1B, TCCR2A, TCCR2B, TCNT0, OCR0A, OCR2A;
volatile uint8_t UCSR0A, UCSR0B, UBRR0H, UBRR0L, UDR0;
volatile uint16_t OCR1A;

enum { CS10, CS11, CS12, WGM12, WGM13 };                                       /* TCCR1B */
enum { WGM10, WGM11, COM1B0 = 4, COM1B1, COM1A0, COM1A1 };                     /* TCCR1A */
enum { CS00, CS01, CS02 };                                                     /* TCCR0B */
enum { CS20, CS21, CS22 };                                                     /* TCCR2B */
enum { WGM20, WGM21, COM2A0 = 6, COM2A1 };                                     /* TCCR2A */
enum { TOIE0, OCIE0A, OCIE0B };                                                /* TIMSK0 */
enum { TOIE1, OCIE1A, OCIE1B };                                                /* TIMSK1 */
enum { PCIE0, PCIE1, PCIE2 };                                                  /* PCICR */
enum { U2X0 = 1, TXEN0 = 3, RXEN0, UDRIE0, TXCIE0, RXCIE0 };                   /* UCSR0A, UCSR0B */
