/* Log-likelihoods as fast as one core sums them up: the yardstick of the other ways, not a way to work.
 *
 * Single precision, bins made beforehand; a row of the table holds one bin of one taxel for all classes, whose number is
 * fixed when compiled and a multiple of sixteen (-DCLASSES=80), so that the sums of a tap stay in registers.
 */
#include <stdint.h>

typedef float Lanes __attribute__((vector_size(64), aligned(4)));
#define VECTORS (CLASSES / 16)

/* Writes (N, CLASSES) sums, times the exponent, of rows `cell` (N, count) of the table. */
void limit_likelihood(const float *table, const int32_t *cell, int64_t N, int64_t count, float exponent, float *out)
{
    for (int64_t n = 0; n < N; n++) {
        Lanes sum[VECTORS] = {{0}};
        for (int64_t i = 0; i < count; i++) {
            const Lanes *row = (const Lanes *)(table + (int64_t)cell[n * count + i] * CLASSES);
            for (int v = 0; v < VECTORS; v++) sum[v] += row[v];
        }
        for (int v = 0; v < VECTORS; v++) ((Lanes *)(out + n * CLASSES))[v] = sum[v] * exponent;
    }
}
