/* A board with a stage around GRBL's own sources: timer, serial line and limit switches.

   board SPEED TRAVEL STATE: SPEED is time of the board per time of the host, TRAVEL that of each axis in steps, STATE a
   file that is kept when the power is off: position in steps, switches pressed by hand, and time (struct stage). The serial
   line, at 115200 baud, is the standard input and output. A switch closes at either end of the travel, 0 and -TRAVEL.

   Interrupts are run by a signal on the thread of the main program, so that they interrupt it as on the processor. */

#include "grbl.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#undef main
#define TURN_US 250 /* of the board */
#define CHARACTER 1389
#define NEVER UINT64_MAX

int firmware_main(void);
void on_TIMER1_COMPA_vect(void), on_TIMER0_OVF_vect(void), on_LIMIT_INT_vect(void);
void on_SERIAL_RX(void), on_SERIAL_UDRE(void);
uint8_t __real_serial_read(void);

static struct stage {
    volatile int32_t place[N_AXIS], pressed;
    volatile uint64_t now;
    unsigned char eeprom[1024];
} *stage;
static double ticks_per_ns;
static int travel, parent;
static struct timespec start;
static const uint64_t turn = F_CPU / 1000000 * TURN_US;
static volatile uint64_t now;
static volatile bool interrupted;

static void read_switches(void)
{
    uint8_t pins = LIMIT_MASK, old = LIMIT_PIN;
    for (int i = 0; i < N_AXIS; i++)
        if (stage->place[i] >= 0 || stage->place[i] <= -travel || stage->pressed >> i & 1) pins &= ~get_limit_pin_mask(i);
    LIMIT_PIN = pins;
    if ((old ^ pins) & LIMIT_PCMSK && PCICR & 1 << LIMIT_INT) on_LIMIT_INT_vect();
}

static void step(void)
{
    on_TIMER1_COMPA_vect();
    for (int i = 0; i < N_AXIS; i++)
        if (STEP_PORT & get_step_pin_mask(i)) stage->place[i] += DIRECTION_PORT & get_direction_pin_mask(i) ? -1 : 1;
    if (TCCR0B) on_TIMER0_OVF_vect();
    read_switches();
}

static void run(int signal)
{
    static unsigned char in[4096], out[4096];
    static size_t read_to, read_at;
    static uint64_t next_step = NEVER, received, sent, lost;
    static const int prescaler[] = {0, 1, 8, 64, 256, 1024, 0, 0};
    if (!(SREG & 0x80) || interrupted) return;
    if (getppid() != parent) _exit(0);
    struct timespec host;
    clock_gettime(CLOCK_MONOTONIC, &host);
    uint64_t due = ticks_per_ns * (1e9 * (host.tv_sec - start.tv_sec) + host.tv_nsec - start.tv_nsec);
    if (due - lost > now + 200 * turn) lost = due - now; /* the host stood still: so did the board */
    uint64_t end = min(due - lost, now + 4 * turn);      /* the main program needs its turns */
    size_t written = 0;
    interrupted = true;
    if (read_at == read_to) {
        ssize_t count = read(0, in, sizeof in);
        read_at = 0, read_to = count > 0 ? count : 0, received = max(received, now);
    }
    read_switches();
    for (;;) {
        if (!(TIMSK1 & 1 << OCIE1A)) next_step = NEVER;
        else if (next_step == NEVER) next_step = now + OCR1A + 1;
        uint64_t next_in = read_at < read_to ? received + CHARACTER : NEVER;
        uint64_t next_out = UCSR0B & 1 << UDRIE0 && written < sizeof out ? max(now, sent + CHARACTER) : NEVER;
        uint64_t next = min(next_step, min(next_in, next_out));
        if (next > end) break;
        now = max(now, next);
        if (next == next_step) {
            step();
            next_step = now + (OCR1A + 1ull) * prescaler[TCCR1B & 7];
        } else if (next == next_in) {
            UDR0 = in[read_at++], received = now;
            on_SERIAL_RX();
        } else {
            on_SERIAL_UDRE();
            out[written++] = UDR0, sent = now;
        }
    }
    stage->now = now = max(now, end);
    if (write(1, out, written) < 0) written = 0; /* nobody reads */
    SREG |= 0x80;
    interrupted = false;
}

void board_wait(uint64_t ticks)
{
    static uint64_t end;
    if (interrupted) {
        now += ticks;
        return;
    }
    end = max(end, now - min(now, 4 * turn)) + ticks; /* the last wait may have been so much too long */
    while (now < end) usleep(TURN_US / 5);
}

uint8_t __wrap_serial_read(void)
{
    uint8_t byte = __real_serial_read();
    if (byte == SERIAL_NO_DATA) usleep(TURN_US / 5);
    return byte;
}

unsigned char eeprom_get_char(unsigned int at) { return stage->eeprom[at]; }

static unsigned char checksum(unsigned int at, unsigned int size)
{
    unsigned char sum = 0;
    while (size--) sum = 31 * sum + stage->eeprom[at++];
    return sum;
}

void eeprom_put_char(unsigned int at, unsigned char value)
{
    stage->eeprom[at] = value;
    sei(); /* as after every write of GRBL's eeprom.c, on which the first start relies */
}

void memcpy_to_eeprom_with_checksum(unsigned int at, char *data, unsigned int size)
{
    memcpy(stage->eeprom + at, data, size);
    eeprom_put_char(at + size, checksum(at, size));
}

int memcpy_from_eeprom_with_checksum(char *data, unsigned int at, unsigned int size)
{
    memcpy(data, stage->eeprom + at, size);
    return checksum(at, size) == stage->eeprom[at + size];
}

int main(int count, char *argument[])
{
    struct sigaction action = {.sa_handler = run, .sa_flags = SA_RESTART};
    double speed = count == 4 ? atof(argument[1]) : 1;
    struct itimerval often = {{0, max(20, TURN_US / speed)}, {0, max(20, TURN_US / speed)}};
    int file = count == 4 ? open(argument[3], O_RDWR) : -1;
    stage = mmap(0, sizeof *stage, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (stage == MAP_FAILED) return 2;
    ticks_per_ns = F_CPU / 1e9 * speed, travel = atoi(argument[2]), parent = getppid();
    PINB = PINC = PIND = 0xff; /* pulled up */
    fcntl(0, F_SETFL, O_NONBLOCK), fcntl(1, F_SETFL, O_NONBLOCK);
    clock_gettime(CLOCK_MONOTONIC, &start);
    sigaction(SIGALRM, &action, 0), setitimer(ITIMER_REAL, &often, 0);
    return firmware_main();
}
