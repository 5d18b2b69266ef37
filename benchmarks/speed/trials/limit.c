/* Trials as fast as one core plays them: the yardstick of the other ways, not a way to work.
 *
 * Single precision, draws made beforehand, L where and M what classes fixed when compiled (-DL=16 -DM=5). With sixteen
 * positions and AVX-512 the positions are the lanes of a register and a whole belief stays in M registers; otherwise,
 * or with -DPLAIN, plain loops that the compiler vectorises. Beliefs are floored after normalising, because subnormal
 * numbers cost ten times as much. Not to be linked with -ffast-math, which would flush them in the whole process.
 */
#include <stdint.h>

#define FLOOR 1e-20f

typedef struct {
    const float *likelihood;  /* (N, M, L), over the maximum of each tap */
    const float *prior;       /* (M, L) */
    const int32_t *tap;       /* (L, M, per_class) */
    const uint8_t *number;    /* (n, deadline) */
    const int32_t *start, *held, *fixation; /* (n) */
    const float *thresholds;  /* (H), increasing */
    int32_t per_class, deadline, H, active;
} Job;

typedef struct {
    int32_t *taps, *what, *where; /* (n, H) */
} Found;

static inline int first_largest(const float *values, int count)
{
    int best = 0;
    for (int i = 1; i < count; i++)
        if (values[i] > values[best]) best = i;
    return best;
}

#if L == 16 && M <= 8 && defined(__AVX512F__) && defined(__AVX512DQ__) && !defined(PLAIN)
#include <immintrin.h>
#define VECTORS 1

typedef struct {
    __m512 row[M];
} Belief;

static inline void load(Belief *belief, const float *prior)
{
    for (int m = 0; m < M; m++) belief->row[m] = _mm512_loadu_ps(prior + m * L);
}

/* Sums of four registers, one lane each. */
static inline __m128 four_sums(const __m512 *rows)
{
    __m128 quarter[4];
    for (int i = 0; i < 4; i++) {
        __m256 half = _mm256_add_ps(_mm512_castps512_ps256(rows[i]), _mm512_extractf32x8_ps(rows[i], 1));
        quarter[i] = _mm_add_ps(_mm256_castps256_ps128(half), _mm256_extractf128_ps(half, 1));
    }
    _MM_TRANSPOSE4_PS(quarter[0], quarter[1], quarter[2], quarter[3]);
    return _mm_add_ps(_mm_add_ps(quarter[0], quarter[1]), _mm_add_ps(quarter[2], quarter[3]));
}

/* Multiplies, normalises and floors; returns the largest what belief and writes the where marginal. */
static inline float update(Belief *belief, const float *likelihood, __m512 *where, float what[8])
{
    __m512 rows[8];
    __m512 sum = _mm512_setzero_ps();
    for (int m = 0; m < 8; m++) rows[m] = _mm512_setzero_ps();
    for (int m = 0; m < M; m++) {
        rows[m] = _mm512_mul_ps(belief->row[m], _mm512_loadu_ps(likelihood + m * L));
        sum = _mm512_add_ps(sum, rows[m]);
    }
    __m256 sums = _mm256_castps128_ps256(four_sums(rows));
    if (M > 4) sums = _mm256_insertf128_ps(sums, four_sums(rows + 4), 1);
    float scale = 1.0f / _mm512_reduce_add_ps(sum);
    for (int m = 0; m < M; m++)
        belief->row[m] = _mm512_max_ps(_mm512_mul_ps(rows[m], _mm512_set1_ps(scale)), _mm512_set1_ps(FLOOR));
    *where = sum;
    sums = _mm256_mul_ps(sums, _mm256_set1_ps(scale));
    _mm256_storeu_ps(what, sums);
    __m128 most = _mm_max_ps(_mm256_castps256_ps128(sums), _mm256_extractf128_ps(sums, 1));
    most = _mm_max_ps(most, _mm_movehl_ps(most, most));
    return _mm_cvtss_f32(_mm_max_ss(most, _mm_movehdup_ps(most)));
}

static inline int where_best(__m512 where)
{
    __m512 most = _mm512_set1_ps(_mm512_reduce_max_ps(where));
    return __builtin_ctz(_mm512_cmpeq_ps_mask(where, most));
}

static inline void shift(Belief *belief, int delta)
{
    __m512i lane = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    __m512i source = _mm512_sub_epi32(lane, _mm512_set1_epi32(delta));
    __mmask16 kept = delta > 0 ? 0xFFFFu << delta : 0xFFFFu >> -delta;
    __mmask16 lost = delta > 0 ? ~(0xFFFFu >> delta) : ~(0xFFFFu << -delta);
    __m512 sum = _mm512_setzero_ps();
    for (int m = 0; m < M; m++) sum = _mm512_add_ps(sum, belief->row[m]);
    float spread = _mm512_mask_reduce_add_ps(lost, sum) / (M * (delta > 0 ? delta : -delta));
    for (int m = 0; m < M; m++)
        belief->row[m] = _mm512_mask_permutexvar_ps(_mm512_set1_ps(spread), kept, source, belief->row[m]);
}

typedef __m512 Where;

#else
#define VECTORS 0
#include <string.h>

typedef struct {
    float row[M][L];
} Belief;

typedef struct {
    float at[L];
} Where;

static inline void load(Belief *belief, const float *prior) { memcpy(belief->row, prior, sizeof belief->row); }

static inline float update(Belief *belief, const float *likelihood, Where *where, float what[M])
{
    float total = 0, most = 0;
    for (int l = 0; l < L; l++) where->at[l] = 0;
    for (int m = 0; m < M; m++) {
        float sum = 0;
        for (int l = 0; l < L; l++) {
            float value = belief->row[m][l] * likelihood[m * L + l];
            belief->row[m][l] = value;
            where->at[l] += value;
            sum += value;
        }
        what[m] = sum;
        total += sum;
    }
    float scale = 1.0f / total;
    for (int m = 0; m < M; m++) {
        what[m] *= scale;
        most = what[m] > most ? what[m] : most;
        for (int l = 0; l < L; l++) {
            float value = belief->row[m][l] * scale;
            belief->row[m][l] = value > FLOOR ? value : FLOOR;
        }
    }
    return most;
}

static inline int where_best(Where where) { return first_largest(where.at, L); }

static inline void shift(Belief *belief, int delta)
{
    int out = delta > 0 ? delta : -delta, kept = L - out;
    int from = delta > 0 ? 0 : out, to = delta > 0 ? out : 0;
    int lost = delta > 0 ? kept : 0, vacated = delta > 0 ? 0 : kept;
    float spread = 0;
    for (int m = 0; m < M; m++)
        for (int l = 0; l < out; l++) spread += belief->row[m][lost + l];
    spread /= M * out;
    for (int m = 0; m < M; m++) {
        memmove(belief->row[m] + to, belief->row[m] + from, kept * sizeof(float));
        for (int l = 0; l < out; l++) belief->row[m][vacated + l] = spread;
    }
}
#endif

/* Whether positions are the lanes of a register. */
int limit_vectors(void) { return VECTORS; }

/* Plays trials first .. last - 1 and decides them at every threshold. */
void limit_trials(const Job *job, const Found *found, int64_t first, int64_t last)
{
    for (int64_t i = first; i < last; i++) {
        Belief belief;
        Where where;
        float what[M > 8 ? M : 8];
        int at = job->start[i], held = job->held[i], decided = 0;
        load(&belief, job->prior);
        for (int t = 0; t < job->deadline; t++) {
            int32_t tap = job->tap[(at * M + held) * job->per_class + job->number[i * job->deadline + t]];
            float most = update(&belief, job->likelihood + (int64_t)tap * M * L, &where, what);
            int over = t == job->deadline - 1;
            if (most > job->thresholds[decided] || over) {
                int best = first_largest(what, M), place = where_best(where);
                while (decided < job->H && (most > job->thresholds[decided] || over)) {
                    int64_t cell = i * job->H + decided++;
                    found->taps[cell] = t + 1;
                    found->what[cell] = best;
                    found->where[cell] = place;
                }
                if (decided == job->H) break;
            }
            if (job->active) {
                int delta = job->fixation[i] - where_best(where);
                if (delta) {
                    shift(&belief, delta);
                    at += delta;
                    at = at < 0 ? 0 : at > L - 1 ? L - 1 : at;
                }
            }
        }
    }
}
