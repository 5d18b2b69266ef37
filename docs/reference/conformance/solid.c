/* Active Bayesian perception of where and what, as a small C program.
 *
 * Lepora, Martinez-Hernandez and Prescott, "A SOLID case for active Bayesian perception in robot touch", 2013.
 * One function for each equation, C99, nothing but libc and libm. It answers the conformance cases of this folder:
 *
 *     cc -O2 -std=c99 -Wall -o solid solid.c -lm && ./solid < case.jsonl
 *
 * With a fitted model compiled in, as on a robot, it reads only the lines of the taps; tap 1 begins from the prior:
 *
 *     solidtouch export-model model.nc --format c-header --out model.h
 *     cc -O2 -std=c99 -I. -DMODEL_HEADER='"model.h"' -o solid solid.c -lm
 *
 * Letters are the paper's: L where classes, M what classes, K taxels, J samples of a tap, B bins. All indices count
 * from 0, class (l, m) lies at l * M + m. Beliefs are carried as natural logarithms: as plain numbers a class that is
 * improbable for long becomes 0 and never comes back. -DSOLIDTOUCH_REAL=float computes in single precision.
 */

#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <tgmath.h>

#ifdef MODEL_HEADER
#include MODEL_HEADER
#if SOLIDTOUCH_FORMAT != 1
#error "solid.c knows format 1 of exported models."
#endif
#endif

#ifndef SOLIDTOUCH_REAL
#define SOLIDTOUCH_REAL double
#endif
typedef SOLIDTOUCH_REAL real; /* what is computed at every tap; tables are made in double */

typedef enum { UNIFORM, UNIFORM_WHAT, PRIOR, CLAMP, CIRCULAR, BORDERS } Border;
static const char *const border_name[BORDERS] = {"uniform", "uniform_what", "prior", "clamp", "circular"};

typedef struct { /* what is known before the first tap */
    char *name; /* JSON text, with its quotes */
    size_t L, M, K, J, B, H;
    double *edges;   /* [K][B + 1] */
    real *log_prob;  /* [L][M][K][B], logarithm of Eq. 2 */
    real *log_prior; /* [L][M] */
    bool *trained;   /* [L][M], which classes belief may be in */
    real exponent;   /* of the likelihood in Eq. 1 */
    Border border;
    double *thresholds; /* [H], theta_W */
    double theta_x;
    long long fixation;
} Model;

typedef struct { /* what changes with every tap */
    long long tap;
    bool over;            /* after a tap that is impossible under every class */
    real *log_belief;     /* [L][M] */
    real *log_likelihood; /* [L][M] */
    real *posterior;      /* [L][M] */
    real *where, *what;   /* [L], [M] */
    real *shifted, *lost, *vacated; /* [L][M], [M], [M], used inside shift */
} State;

/* ---- Bad input: one sentence that says where, and exit code 2 ---- */

static struct {
    size_t line;
    const char *name, *key;
} place;

static void fail(const char *sentence, ...)
{
    va_list values;
    fflush(stdout);
    fprintf(stderr, "solid: line %zu", place.line);
    if (place.name) fprintf(stderr, ", case %s", place.name);
    if (place.key) fprintf(stderr, ", key \"%s\"", place.key);
    fprintf(stderr, ": ");
    va_start(values, sentence);
    vfprintf(stderr, sentence, values);
    va_end(values);
    fprintf(stderr, "\n");
    exit(2);
}

static void *allocate(size_t count, size_t size)
{
    void *memory = calloc(count > 0 ? count : 1, size);
    if (!memory) fail("there is not enough memory.");
    return memory;
}

/* ---- The paper ---- */

/* Logarithm of a sum of numbers given by their logarithms. */
static real log_sum(const real *logs, size_t n)
{
    real top = -INFINITY, sum = 0;
    for (size_t i = 0; i < n; i++)
        if (logs[i] > top) top = logs[i];
    if (top == -INFINITY) return top;
    for (size_t i = 0; i < n; i++) sum += exp(logs[i] - top);
    return top + log(sum);
}

static real log_add(real a, real b)
{
    const real both[2] = {a, b};
    return log_sum(both, 2);
}

/* Text below Eq. 2: bin b is [edges[b], edges[b + 1]), the last one is closed; outside are the end bins. */
static size_t bin_index(double sample, const double *edges, size_t B)
{
    size_t low = 0, high = B + 1; /* the number of edges that do not lie above the sample */
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (edges[middle] <= sample)
            low = middle + 1;
        else
            high = middle;
    }
    return low == 0 ? 0 : low > B ? B - 1 : low - 1;
}

#ifndef MODEL_HEADER

/* Eq. 2: logarithms of P_k(b) from the occupation numbers h_k(b) of one class and taxel. */
static void histogram_log_probabilities(const double *counts, double pseudocount, size_t B, real *log_prob)
{
    double total = 0;
    for (size_t b = 0; b < B; b++) total += counts[b] + pseudocount;
    if (!(total > 0)) fail("a histogram without any sample has no distribution when the pseudocount is 0.");
    for (size_t b = 0; b < B; b++) log_prob[b] = (real)(log(counts[b] + pseudocount) - log(total));
}

#endif

/* Eq. 1: log P(z | x_l, w_m) of a tap with samples [J][K]. */
static void tap_log_likelihood(const Model *m, const double *samples, real *log_likelihood)
{
    const size_t N = m->L * m->M;
    for (size_t c = 0; c < N; c++) log_likelihood[c] = 0;
    for (size_t j = 0; j < m->J; j++)
        for (size_t k = 0; k < m->K; k++) {
            const double sample = samples[j * m->K + k], *edges = m->edges + k * (m->B + 1);
            const size_t b = bin_index(sample, edges, m->B);
            for (size_t c = 0; c < N; c++) log_likelihood[c] += m->log_prob[(c * m->K + k) * m->B + b];
        }
    for (size_t c = 0; c < N; c++) log_likelihood[c] = m->exponent * log_likelihood[c];
}

/* Eq. 3 and 4: from the log belief before the tap to that after it; returns log P(z_t | z_1 .. z_{t-1}). */
static real update(const Model *m, State *s)
{
    const size_t N = m->L * m->M;
    for (size_t c = 0; c < N; c++) s->log_belief[c] += s->log_likelihood[c];
    const real log_evidence = log_sum(s->log_belief, N);
    if (log_evidence > -INFINITY)
        for (size_t c = 0; c < N; c++) s->log_belief[c] = s->log_belief[c] - log_evidence;
    return log_evidence;
}

/* Eq. 5 */
static void where_marginal(const Model *m, State *s)
{
    for (size_t l = 0; l < m->L; l++) {
        s->where[l] = 0;
        for (size_t w = 0; w < m->M; w++) s->where[l] += exp(s->log_belief[l * m->M + w]);
    }
}

/* Eq. 6 */
static void what_marginal(const Model *m, State *s)
{
    for (size_t w = 0; w < m->M; w++) {
        s->what[w] = 0;
        for (size_t l = 0; l < m->L; l++) s->what[w] += exp(s->log_belief[l * m->M + w]);
    }
}

static size_t largest(const real *values, size_t n)
{
    size_t best = 0;
    for (size_t i = 1; i < n; i++)
        if (values[i] > values[best]) best = i;
    return best;
}

/* The class if its marginal is greater than the threshold, -1 otherwise; a threshold of 1 never decides. */
static long long decide(const real *marginal, size_t best, double threshold)
{
    return threshold < 1 && (double)marginal[best] > threshold ? (long long)best : -1;
}

/* Eq. 7 */
static long long what_decision(const Model *m, const State *s, double threshold)
{
    return decide(s->what, largest(s->what, m->M), threshold);
}

/* Eq. 8 */
static long long where_decision(const Model *m, const State *s)
{
    return decide(s->where, largest(s->where, m->L), m->theta_x);
}

/* Eq. 10, and no move while the place is not decided. */
static long long fixation_move(const Model *m, long long where)
{
    return where < 0 ? 0 : m->fixation - where;
}

/* The trained place of object w nearest to place l, the lower of two equally near; -1 if there is none. */
static long long nearest(const Model *m, long long l, size_t w)
{
    const long long L = (long long)m->L, M = (long long)m->M;
    for (long long away = 0; away < L; away++) {
        if (l - away >= 0 && m->trained[(l - away) * M + (long long)w]) return l - away;
        if (l + away < L && m->trained[(l + away) * M + (long long)w]) return l + away;
    }
    return -1;
}

/* Where the belief about place l and object w comes to lie after a move by d; -1 if it is lost. */
static long long target(const Model *m, size_t l, size_t w, long long d)
{
    const long long L = (long long)m->L;
    long long to = (long long)l + d;
    if (m->border == CIRCULAR) to = (to % L + L) % L;
    if (m->border == CLAMP) to = nearest(m, to < 0 ? 0 : to >= L ? L - 1 : to, w);
    return to >= 0 && to < L && m->trained[(size_t)to * m->M + w] ? to : -1;
}

/* Whether no belief comes to lie on a trained class after a move by d, under borders other than "clamp". */
static bool is_vacated(const Model *m, size_t l, size_t w, long long d)
{
    return m->trained[l * m->M + w] && target(m, l, w, -d) < 0;
}

/* Log belief in each vacated class of object w; what was lost and how many classes are vacated is given by object. */
static real vacated_cell(const Model *m, const real *lost, const real *vacated, size_t w)
{
    real classes = 0;
    for (size_t c = 0; c < (m->border == UNIFORM ? m->M : m->L * m->M); c++)
        classes += m->border == UNIFORM ? vacated[c] : (real)m->trained[c];
    switch (m->border) {
    case UNIFORM: return log_sum(lost, m->M) - log(classes);
    case UNIFORM_WHAT: return lost[w] - log(vacated[w]);
    case PRIOR: return -log(classes);
    default: return -INFINITY;
    }
}

/* Eq. 9: belief about place l becomes belief about place l + d. */
static void shift(const Model *m, State *s, long long d)
{
    const size_t L = m->L, M = m->M;
    if (d == 0) return;
    for (size_t c = 0; c < L * M; c++) s->shifted[c] = -INFINITY;
    for (size_t w = 0; w < M; w++) {
        size_t free = 0; /* under "circular" the vacated place that the next lost belief goes to */
        s->lost[w] = -INFINITY;
        s->vacated[w] = 0;
        for (size_t l = 0; l < L; l++) {
            if (!m->trained[l * M + w]) continue;
            const long long to = target(m, l, w, d);
            real *cell = to < 0 ? s->lost + w : s->shifted + (size_t)to * M + w;
            if (to < 0 && m->border == CIRCULAR) {
                while (!is_vacated(m, free, w, d)) free++;
                cell = s->shifted + free++ * M + w;
            }
            s->vacated[w] += to < 0; /* as many as are lost */
            *cell = log_add(*cell, s->log_belief[l * M + w]);
        }
    }
    if (m->border != CLAMP && m->border != CIRCULAR)
        for (size_t c = 0; c < L * M; c++)
            if (is_vacated(m, c / M, c % M, d)) s->shifted[c] = vacated_cell(m, s->lost, s->vacated, c % M);
    const real total = log_sum(s->shifted, L * M); /* log 1 and rounding, except under border "prior" */
    for (size_t c = 0; c < L * M; c++) s->log_belief[c] = s->shifted[c] - total;
}

/* A new sequence of taps: nothing is known but the prior. */
static void begin(const Model *m, State *s)
{
    s->tap = 0;
    s->over = false;
    for (size_t c = 0; c < m->L * m->M; c++) s->log_belief[c] = m->log_prior[c];
}

/* ---- Writing: JSON with 17 significant digits, which tell every double from the next ---- */

static void write_number(double x)
{
    if (isfinite(x))
        printf("%.17g", x);
    else
        printf("null");
}

static void write_row(const real *values, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        putchar(i ? ',' : '[');
        write_number((double)values[i]);
    }
    putchar(']');
}

static void write_matrix(const char *key, const real *values, size_t rows, size_t columns)
{
    printf(",\"%s\":", key);
    for (size_t i = 0; i < rows; i++) {
        putchar(i ? ',' : '[');
        write_row(values + i * columns, columns);
    }
    putchar(']');
}

static void write_answer(const Model *m, State *s, real log_evidence)
{
    for (size_t c = 0; c < m->L * m->M; c++) s->posterior[c] = exp(s->log_belief[c]);
    write_matrix("log_likelihood", s->log_likelihood, m->L, m->M);
    printf(",\"log_evidence\":");
    write_number((double)log_evidence);
    write_matrix("posterior", s->posterior, m->L, m->M);
    printf(",\"where\":");
    write_row(s->where, m->L);
    printf(",\"what\":");
    write_row(s->what, m->M);
    printf(",\"decisions\":[");
    for (size_t h = 0; h < m->H; h++) {
        const long long decided = what_decision(m, s, m->thresholds[h]);
        if (h) putchar(',');
        if (decided < 0)
            printf("null");
        else
            printf("%lld", decided);
    }
    printf("],\"move\":%lld", fixation_move(m, where_decision(m, s)));
    write_matrix("log_posterior", s->log_belief, m->L, m->M);
}

/* One tap: the move before it, its samples, and what is believed, decided and done after it. */
static void perceive(const Model *m, State *s, long long move, const double *samples)
{
    printf("{\"case\":%s,\"tap\":%lld", m->name, s->tap);
    shift(m, s, move);
    tap_log_likelihood(m, samples, s->log_likelihood);
    const real log_evidence = update(m, s);
    where_marginal(m, s);
    what_marginal(m, s);
    s->over = !(log_evidence > -INFINITY);
    if (s->over)
        printf(",\"error\":\"zero_evidence\"");
    else
        write_answer(m, s, log_evidence);
    printf("}\n");
    fflush(stdout);
}

/* ---- Reading JSON: an object is a list of keys and of places in the text, read from when asked for ---- */

enum { FIELDS = 64, DEPTH = 8 };

typedef struct {
    size_t n;
    struct { const char *key, *value; } field[FIELDS];
} Object;

static const char *read_object(const char *text, Object *object, int depth);

static const char *skip_space(const char *text) { return text + strspn(text, " \t\r\n"); }

static const char *expect(const char *text, char mark)
{
    text = skip_space(text);
    if (*text != mark) fail("this is not a JSON object, a '%c' is missing.", mark);
    return skip_space(text + 1);
}

static const char *skip_string(const char *text)
{
    for (text = expect(text, '"'); *text != '"'; text++) {
        if (*text == '\\') text++;
        if (*text == '\0') fail("a string does not end.");
    }
    return text + 1;
}

static const char *skip_value(const char *text, int depth)
{
    if (depth == 0) fail("lists are nested too deeply.");
    if (*text == '"') return skip_space(skip_string(text));
    if (*text == '{') return read_object(text, NULL, depth - 1);
    if (*text == '[') {
        text = skip_space(text + 1);
        if (*text == ']') return skip_space(text + 1);
        for (text = skip_value(text, depth - 1); *text == ',';) text = skip_value(skip_space(text + 1), depth - 1);
        return expect(text, ']');
    }
    const size_t length = strspn(text, "+-.0123456789Eaeflnrstu");
    if (length == 0) fail("this is not a JSON object, a value is missing.");
    return skip_space(text + length);
}

static const char *read_object(const char *text, Object *object, int depth)
{
    text = expect(text, '{');
    if (object) object->n = 0;
    if (*text == '}') return skip_space(text + 1);
    for (;; text = skip_space(text + 1)) {
        const char *key = text + 1, *value = expect(skip_string(text), ':');
        text = skip_value(value, depth);
        if (object) {
            if (object->n == FIELDS) fail("there are more than %d keys.", FIELDS);
            object->field[object->n].key = key;
            object->field[object->n++].value = value;
        }
        if (*text != ',') return expect(text, '}');
    }
}

static const char *find(const Object *object, const char *key)
{
    const size_t length = strlen(key);
    for (size_t i = 0; i < object->n; i++)
        if (strncmp(object->field[i].key, key, length) == 0 && object->field[i].key[length] == '"')
            return object->field[i].value;
    return NULL;
}

static const char *value_of(const Object *object, const char *key)
{
    const char *value = find(object, key);
    place.key = key;
    if (!value) fail("it is missing.");
    return value;
}

/* Numbers in nested lists of the given sizes, the last axis runs fastest; NULL where there is something else. */
static const char *read_list(const char *text, const size_t *sizes, size_t axes, double **out)
{
    if (axes == 0) {
        char *end;
        *(*out) = strtod(text, &end);
        if (end == text || end != text + strspn(text, "+-.0123456789Ee") || !isfinite(*(*out)++)) return NULL;
        return skip_space(end);
    }
    if (*text++ != '[') return NULL;
    text = skip_space(text);
    for (size_t i = 0; i < sizes[0]; i++) {
        if (i && *text++ != ',') return NULL;
        text = read_list(skip_space(text), sizes + 1, axes - 1, out);
        if (!text) return NULL;
    }
    return *text == ']' ? skip_space(text + 1) : NULL;
}

static double *read_numbers(const Object *object, const char *key, size_t axes, const size_t *sizes)
{
    char shape[128] = "";
    size_t n = 1, used = 0;
    const char *text = value_of(object, key);
    for (size_t i = 0; i < axes; i++) {
        n *= sizes[i];
        used += (size_t)snprintf(shape + used, sizeof shape - used, "%s%zu", i ? " x " : "", sizes[i]);
    }
    double *values = allocate(n, sizeof *values), *next = values;
    if (!read_list(text, sizes, axes, &next)) fail("it must hold %s finite numbers.", axes ? shape : "one of");
    return values;
}

static double read_number(const Object *object, const char *key)
{
    double *value = read_numbers(object, key, 0, NULL), x = *value;
    free(value);
    return x;
}

static long long read_integer(const Object *object, const char *key, double low, double high)
{
    const double x = read_number(object, key);
    if (!(x >= low && x <= high && x == floor(x))) fail("it must be a whole number from %.0f to %.0f.", low, high);
    return (long long)x;
}

typedef struct {
    char *text;
    size_t size;
} Line;

static bool read_line(Line *line)
{
    size_t used = 0;
    do {
        if (line->size - used < 2) {
            line->size = 2 * line->size + 4096;
            line->text = realloc(line->text, line->size);
            if (!line->text) fail("there is not enough memory.");
        }
        const size_t room = line->size - used;
        if (!fgets(line->text + used, room < 1 << 30 ? (int)room : 1 << 30, stdin)) break;
        used += strlen(line->text + used);
    } while (used == 0 || line->text[used - 1] != '\n');
    if (used > 0) place.line++;
    return used > 0;
}

static void free_model(Model *m)
{
    free(m->name), free(m->edges), free(m->log_prob), free(m->log_prior), free(m->trained);
    free(m->thresholds);
    memset(m, 0, sizeof *m);
}

/* The arrays of the state are parts of one block, which its first one holds. */
static void new_state(const Model *m, State *s)
{
    const size_t N = m->L * m->M;
    free(s->log_belief);
    s->log_belief = allocate(4 * N + m->L + 3 * m->M, sizeof(real));
    s->log_likelihood = s->log_belief + N;
    s->posterior = s->log_likelihood + N;
    s->shifted = s->posterior + N;
    s->where = s->shifted + N;
    s->what = s->where + m->L;
    s->lost = s->what + m->M;
    s->vacated = s->lost + m->M;
    begin(m, s);
}

static Border border_called(const char *text, size_t length)
{
    Border border = UNIFORM;
    while (border < BORDERS && (strlen(border_name[border]) != length || strncmp(border_name[border], text, length)))
        border++;
    if (border == BORDERS) fail("it must be uniform, uniform_what, prior, clamp or circular.");
    return border;
}

static char *copy_text(const char *text, size_t length)
{
    char *copy = allocate(length + 1, 1);
    memcpy(copy, text, length);
    return copy;
}

/* ---- The model: compiled in, or from the header line of a case ---- */

/* Classes whose probabilities are all 0 were never trained. */
static void find_trained(Model *m)
{
    const size_t table = m->K * m->B;
    m->trained = allocate(m->L * m->M, sizeof(bool));
    for (size_t i = 0; i < m->L * m->M * table; i++)
        if (m->log_prob[i] > -INFINITY) m->trained[i / table] = true;
}

#ifdef MODEL_HEADER

static void compiled_model(Model *m)
{
    place.name = m->name = copy_text("\"model\"", 7);
    m->L = SOLIDTOUCH_L, m->M = SOLIDTOUCH_M, m->K = SOLIDTOUCH_K, m->J = SOLIDTOUCH_J, m->B = SOLIDTOUCH_B, m->H = 1;
    m->edges = allocate(m->K * (m->B + 1), sizeof(double));
    for (size_t k = 0, i = 0; k < m->K; k++)
        for (size_t b = 0; b <= m->B; b++) m->edges[i++] = (double)solidtouch_edges[k][b];
    m->log_prob = allocate(m->L * m->M * m->K * m->B, sizeof(real));
    memcpy(m->log_prob, solidtouch_log_prob, sizeof solidtouch_log_prob);
    m->log_prior = allocate(m->L * m->M, sizeof(real));
    memcpy(m->log_prior, solidtouch_log_prior, sizeof solidtouch_log_prior);
    find_trained(m);
    m->exponent = (real)SOLIDTOUCH_EXPONENT;
    m->border = border_called(SOLIDTOUCH_BORDER, strlen(SOLIDTOUCH_BORDER));
    m->thresholds = allocate(1, sizeof(double));
    m->thresholds[0] = SOLIDTOUCH_THETA_W;
    m->theta_x = SOLIDTOUCH_THETA_X;
    m->fixation = SOLIDTOUCH_FIXATION;
#ifdef SOLIDTOUCH_SATURATION
    if (SOLIDTOUCH_SATURATION > 0) fail("the model has a saturation, which is beyond the paper and not done here.");
#endif
}

#else

static void equal_bins(double low, double high, size_t B, double *edges)
{
    for (size_t b = 0; b < B; b++) edges[b] = low + (high - low) * (double)b / (double)B;
    edges[B] = high;
}

/* One range over the samples of all taxels and classes; an idle taxel would spend all its bins on noise. */
static void training_edges(Model *m, const double *taps, size_t N)
{
    double *low = allocate(m->K, sizeof *low), *high = allocate(m->K, sizeof *high);
    double lowest = INFINITY, highest = -INFINITY;
    for (size_t k = 0; k < m->K; k++) {
        low[k] = high[k] = taps[k];
        for (size_t i = k; i < N * m->J * m->K; i += m->K) {
            low[k] = fmin(low[k], taps[i]);
            high[k] = fmax(high[k], taps[i]);
        }
        lowest = fmin(lowest, low[k]);
        highest = fmax(highest, high[k]);
    }
    if (!(lowest < highest)) fail("all samples are equal and have no range.");
    if (!isfinite((highest - lowest) * (double)m->B)) fail("the range of the samples is too large.");
    for (size_t k = 0; k < m->K; k++) equal_bins(lowest, highest, m->B, m->edges + k * (m->B + 1));
    free(low), free(high);
}

static size_t count_elements(const char *text)
{
    size_t n = 0;
    if (*text != '[') fail("it must be a list.");
    for (text = skip_space(text + 1); *text != ']'; n++) {
        text = skip_value(text, DEPTH);
        if (*text == ',') text = skip_space(text + 1);
    }
    return n;
}

static void write_doubles(const double *values, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        putchar(i ? ',' : '[');
        write_number(values[i]);
    }
    putchar(']');
}

static void write_fit(const Model *m, const double *counts)
{
    printf("{\"case\":%s,\"tap\":0,\"edges\":", m->name);
    write_doubles(m->edges, m->B + 1);
    printf(",\"counts\":");
    for (size_t i = 0; i < m->L * m->M * m->K; i++) {
        printf("%s", i == 0 ? "[[[" : i % (m->M * m->K) == 0 ? "]],[[" : i % m->K == 0 ? "],[" : ",");
        write_doubles(counts + i * m->B, m->B);
    }
    printf("]]]}\n");
    fflush(stdout);
}

/* Edges and counts from labelled taps. */
static double *train(Model *m, const Object *training)
{
    const size_t N = count_elements(value_of(training, "where"));
    if (N == 0) fail("there is no tap to train on.");
    double *where = read_numbers(training, "where", 1, (size_t[]){N});
    double *what = read_numbers(training, "what", 1, (size_t[]){N});
    double *taps = read_numbers(training, "taps", 3, (size_t[]){N, m->J, m->K});
    double *counts = allocate(m->L * m->M * m->K * m->B, sizeof *counts);
    m->edges = allocate(m->K * (m->B + 1), sizeof *m->edges);
    training_edges(m, taps, N);
    for (size_t n = 0; n < N; n++) {
        const double l = where[n], w = what[n];
        place.key = "where and what";
        if (!(l >= 0 && l < (double)m->L && l == floor(l) && w >= 0 && w < (double)m->M && w == floor(w)))
            fail("training tap %zu has no class of this case.", n);
        double *histograms = counts + ((size_t)l * m->M + (size_t)w) * m->K * m->B;
        for (size_t i = 0; i < m->J * m->K; i++) {
            const size_t k = i % m->K;
            histograms[k * m->B + bin_index(taps[n * m->J * m->K + i], m->edges + k * (m->B + 1), m->B)]++;
        }
    }
    free(where), free(what), free(taps);
    write_fit(m, counts);
    return counts;
}

static void read_edges(Model *m, const Object *header)
{
    const char *text = value_of(header, "edges");
    const bool each = *text == '[' && *skip_space(text + 1) == '[';
    const size_t E = m->B + 1, K = each ? m->K : 1;
    double *edges = read_numbers(header, "edges", each ? 2 : 1, each ? (size_t[]){K, E} : (size_t[]){E, 1});
    for (size_t i = 0; i < K * E; i++)
        if (i % E && !(edges[i - 1] < edges[i])) fail("edges must increase.");
    m->edges = allocate(m->K * E, sizeof *m->edges);
    for (size_t k = 0; k < m->K; k++) memcpy(m->edges + k * E, each ? edges + k * E : edges, E * sizeof *edges);
    free(edges);
}

static void not_negative(const double *values, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (!(values[i] >= 0)) fail("a number is negative.");
}

static void read_measurement_model(Model *m, const Object *header)
{
    const size_t cells = m->L * m->M * m->K * m->B, sizes[4] = {m->L, m->M, m->K, m->B};
    const char *training_text = find(header, "training"), *saturation = find(header, "saturation");
    double *table, pseudocount;
    place.key = NULL;
    if ((find(header, "counts") != NULL) + (find(header, "probabilities") != NULL) + (training_text != NULL) != 1)
        fail("exactly one of \"counts\", \"probabilities\" and \"training\" must be there.");
    if (saturation && strncmp(saturation, "null", 4) != 0)
        fail("the model has a saturation, which is beyond the paper and not done here.");
    if (!training_text) read_edges(m, header);
    m->log_prob = allocate(cells, sizeof(real));
    if (find(header, "probabilities")) {
        table = read_numbers(header, "probabilities", 4, sizes);
        not_negative(table, cells);
        for (size_t i = 0; i < cells; i++) m->log_prob[i] = (real)log(table[i]);
    } else {
        pseudocount = read_number(header, "pseudocount");
        not_negative(&pseudocount, 1);
        if (training_text) {
            Object training;
            place.key = "training";
            read_object(training_text, &training, DEPTH);
            table = train(m, &training);
        } else {
            table = read_numbers(header, "counts", 4, sizes);
            not_negative(table, cells);
        }
        for (size_t i = 0; i < cells; i += m->B)
            histogram_log_probabilities(table + i, pseudocount, m->B, m->log_prob + i);
    }
    find_trained(m);
    free(table);
}

static void read_prior(Model *m, const Object *header)
{
    const size_t N = m->L * m->M;
    double sum = 0, *prior = read_numbers(header, "prior", 2, (size_t[]){m->L, m->M});
    not_negative(prior, N);
    m->log_prior = allocate(N, sizeof(real));
    for (size_t c = 0; c < N; c++) {
        sum += prior[c];
        m->log_prior[c] = (real)log(prior[c]);
    }
    if (!(fabs(sum - 1) < 1e-6)) fail("its sum must be 1 and is %g.", sum);
    free(prior);
}

static real read_power(const Model *m, const Object *header)
{
    const char *text = value_of(header, "power");
    if (strncmp(text, "\"J\"", 3) == 0) return 1 / (real)m->J;
    if (strncmp(text, "\"JK\"", 4) == 0) return 1 / ((real)m->J * (real)m->K);
    if (strncmp(text, "\"none\"", 6) == 0) return 1;
    if (*text == '"') fail("it must be J, JK, none or a number.");
    const real power = (real)read_number(header, "power");
    if (!(power > 0)) fail("it must be positive.");
    return power;
}

static void read_case(const Object *header, Model *m)
{
    const char *text;
    free_model(m);
    place.name = NULL;
    text = value_of(header, "case");
    place.name = m->name = copy_text(text, (size_t)(skip_string(text) - text));
    if (read_integer(header, "format", 1, 1e6) != 1) fail("this program knows format 1.");
    m->L = (size_t)read_integer(header, "L", 1, 1e6), m->M = (size_t)read_integer(header, "M", 1, 1e6);
    m->K = (size_t)read_integer(header, "K", 1, 1e6), m->J = (size_t)read_integer(header, "J", 1, 1e6);
    m->B = (size_t)read_integer(header, "B", 1, 1e6);
    place.key = NULL;
    if ((double)m->L * (double)m->M * (double)m->K * (double)m->B > 1e9) fail("the sizes are too large.");
    read_measurement_model(m, header);
    read_prior(m, header);
    m->exponent = read_power(m, header);
    text = value_of(header, "border");
    m->border = border_called(text + 1, (size_t)(skip_string(text) - text) - 2);
    m->H = count_elements(value_of(header, "thresholds"));
    m->thresholds = read_numbers(header, "thresholds", 1, &m->H);
    m->theta_x = read_number(header, "theta_x");
    m->fixation = read_integer(header, "fixation", 0, (double)m->L - 1);
}

#endif

/* ---- Line by line ---- */

static void read_tap(const Object *object, const Model *m, State *s)
{
    const long long tap = read_integer(object, "tap", 1, 1e9), move = read_integer(object, "move", -1e9, 1e9);
#ifdef MODEL_HEADER
    if (tap == 1) begin(m, s);
#endif
    place.key = "tap";
    if (tap != s->tap + 1) fail("it is %lld, and after tap %lld must come %lld.", tap, s->tap, s->tap + 1);
    double *samples = read_numbers(object, "samples", 2, (size_t[]){m->J, m->K});
    s->tap = tap;
    if (!s->over) perceive(m, s, move, samples);
    free(samples);
}

int main(void)
{
    Line line = {NULL, 0};
    Object object;
    Model model = {0};
    State state = {0};
#ifdef MODEL_HEADER
    compiled_model(&model);
    new_state(&model, &state);
#endif
    while (read_line(&line)) {
        place.key = NULL;
        if (*skip_space(line.text) == '\0') continue;
        if (*read_object(line.text, &object, DEPTH) != '\0') fail("something follows the JSON object.");
        if (find(&object, "tap")) {
            if (!model.name) fail("a tap comes before the header of its case.");
            read_tap(&object, &model, &state);
            continue;
        }
#ifdef MODEL_HEADER
        value_of(&object, "tap");
#else
        read_case(&object, &model);
        new_state(&model, &state);
#endif
    }
    free(line.text);
    free_model(&model);
    free(state.log_belief);
    return fflush(stdout) == 0 ? 0 : 2;
}
