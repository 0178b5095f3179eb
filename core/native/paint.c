/* Paints shares one by one. The numpy reference is core/image/pyramid.py and core/image/source_image.py. */

#include "kiriko.h"

#define LEAST 1e-100 /* as in flat_picture.py */
#define UPRIGHT 1e-3 /* as in picture.py; the next four as in pyramid.py */
#define SIDE 0.9
#define APART 0.25
#define POINT_SIDE 0.2
#define MOST_READS 8
#define WELL_BELOW 0.999 /* of a limit: safely below it despite rounding */
#define MOST_LEVELS 64
#define MOST_TAPS (2 * MOST_READS * MOST_READS) /* of a share: up to eight places along each side, on two levels */
#define STRIPE 1024     /* display pixels */

/* The four channels of a pixel, unaligned. */
typedef float Colour __attribute__((vector_size(16), aligned(4), may_alias));

typedef double Pair __attribute__((vector_size(16)));
typedef int32_t Whole __attribute__((vector_size(8)));

/* Mapping of places to a level: scale from the picture's pixels, the last pixel, and the last one with a right or
   lower neighbour. */
typedef struct {
    double scale[2], most[2];
    int32_t last[2];
} Grid;

/* Reads of a share along a side: their number, and positions relative to the side's centre. */
typedef struct {
    int n;
    const double *step; /* shared by all sides read at one place, or at two, four or eight fully separated ones */
    double own[MOST_READS];
} Side;

/* A picture's levels, and the sides read at four and at eight fully separated places. */
typedef struct {
    const Level *levels;
    int64_t n_levels;
    Grid grids[MOST_LEVELS];
    Side four, eight;
} Reader;

/* A share on the picture: its centre, two sides scaled to standard deviations, and weight. */
typedef struct {
    double at[2], first[2], second[2], weight;
} Footprint;

/* Fraction of a box-shaped footprint between two lines; its centre moves to this part's. */
static double keep_within(double *x, double low, double high, double variance) {
    double room = *x - low < high - *x ? *x - low : high - *x;
    if (room * room >= 3 * variance) return room >= 0; /* all or nothing */
    double half = variance > 0 ? sqrt(3 * variance) : 0, before = low - (*x - half), after = *x + half - high;
    if (!(before > 0)) before = 0;
    if (!(after > 0)) after = 0;
    double share = clip(1 - (before + after) / (2 * half > LEAST ? 2 * half : LEAST), 0, 1);
    if (share > 0) *x += 0.5 * (before - after);
    return share;
}

/* Find the footprint of a share on the picture; false if it lies outside or has no weight. */
static bool find_footprint(const FlatTaps *s, int64_t i, Footprint *f) {
    const double *m = s->matrix, *size = s->size;
    double x = s->view_xy[2 * i], y = s->view_xy[2 * i + 1];
    double w = m[6] * x + m[7] * y + m[8];
    if (!(w > 0)) return false;
    double inverse = 1 / w;
    double u = (m[0] * x + m[1] * y + m[2]) * inverse, v = (m[3] * x + m[4] * y + m[5]) * inverse;
    double x_scale = size[0] * inverse, y_scale = -size[1] * inverse; /* v points up, pixel rows down */
    double by_x[2] = {(m[0] - u * m[6]) * x_scale, (m[3] - v * m[6]) * y_scale};
    double by_y[2] = {(m[1] - u * m[7]) * x_scale, (m[4] - v * m[7]) * y_scale};

    /* the triangular root of the covariance; it starts with y if rounding is as large as xx */
    double xx = s->covariance[i], xy = s->covariance[s->apart + i], yy = s->covariance[2 * s->apart + i];
    bool is_upright = xx < UPRIGHT * yy;
    double near = is_upright ? yy : xx, far = is_upright ? xx : yy;
    const double *by_near = is_upright ? by_y : by_x, *by_far = is_upright ? by_x : by_y;
    double reach = near > 0 ? sqrt(near) : 0;
    double along_far = xy / (reach > LEAST ? reach : LEAST);
    if (!(along_far * along_far < WELL_BELOW * far)) {
        double most = far > 0 ? sqrt(far) : 0;
        along_far = clip(along_far, -most, most);
    }
    double rest = far - along_far * along_far;
    double across_far = rest > 0 ? sqrt(rest) : 0;
    for (int k = 0; k < 2; k++) {
        f->first[k] = reach * by_near[k] + along_far * by_far[k];
        f->second[k] = across_far * by_far[k];
    }
    double x_variance = f->first[0] * f->first[0] + f->second[0] * f->second[0];
    double y_variance = f->first[1] * f->first[1] + f->second[1] * f->second[1];

    f->at[0] = u * size[0];
    f->at[1] = (1 - v) * size[1];
    double across = keep_within(f->at, s->low[0] * size[0], s->high[0] * size[0], x_variance);
    double along = keep_within(f->at + 1, (1 - s->high[1]) * size[1], (1 - s->low[1]) * size[1], y_variance);
    f->weight = s->throughput ? s->area[i] * s->throughput[i] : s->area[i];
    return across * along >= 0.5 && f->weight > 0;
}

/* Read one level, times weight: centres of pixels at + 0.5, edges extended. Returns the place for the next tap, as
   do all readers. */
static inline Tap *read_level(const Reader *reader, int64_t k, double x, double y, double weight, Tap *tap) {
    const Grid *grid = reader->grids + k;
    x = clip(x * grid->scale[0] - 0.5, 0, grid->most[0]);
    y = clip(y * grid->scale[1] - 0.5, 0, grid->most[1]);
    int32_t column = (int32_t)x, row = (int32_t)y;
    column = column > grid->last[0] ? grid->last[0] : column;
    row = row > grid->last[1] ? grid->last[1] : row;
    Pair part = (Pair){x, y} - __builtin_convertvector(((Whole){column, row}), Pair);
    double lower = weight * part[1];
    Pair rows = {weight - lower, lower}, right = rows * part[0], left = rows - right;
    *tap = (Tap){.row = row,
                 .column = column,
                 .level = (int32_t)k,
                 .weight = {(float)left[0], (float)right[0], (float)left[1], (float)right[1]}};
    return tap + 1;
}

/* Two mixed levels, whose interpolated reads have a given variance along each axis. */
typedef struct {
    int64_t lower;
    double upper_part; /* of the next one */
} Mix;

static Mix find_mix(const Reader *reader, double variance) {
    if (variance == 0) return (Mix){0, 0};
    double relative = 1 + 4 * variance; /* to the level's variance */
    int64_t k = 0, last = reader->n_levels - 1;
    for (; k < last && relative >= 4; k++) relative *= 0.25;
    return (Mix){k, k < last ? clip((relative - 1) / 3, 0, 1) : 0};
}

/* Read at a place, times weight. */
static inline Tap *read_place(const Reader *reader, Mix mix, double x, double y, double weight, Tap *tap) {
    double of_upper = weight * mix.upper_part, of_lower = weight - of_upper;
    if (of_lower > 0) tap = read_level(reader, mix.lower, x, y, of_lower, tap);
    if (of_upper > 0) tap = read_level(reader, mix.lower + 1, x, y, of_upper, tap);
    return tap;
}

static const double ONE[1] = {0}, TWO[2] = {-1, 1};

static inline double squared(double number) { return number * number; }

static void find_own_side(double length, Side *side) {
    double two = clip(length / POINT_SIDE - 1, 0, 1), relative = length / SIDE;
    double four = clip((relative - 2) / APART, 0, 1), eight = clip((relative / 2 - 2) / APART, 0, 1);
    side->n = eight > 0 ? 8 : four > 0 ? 4 : two > 0 ? 2 : 1;
    side->step = side->own;
    double far = two < 1 || four > 0 ? sqrt(two / (1 + four * four / 4 + eight * eight / 16)) : 1;
    const double steps[3] = {far, four * far / 2, eight * far / 4};
    for (int k = 0; k < side->n; k++) {
        side->own[k] = 0;
        for (int i = 0, half = side->n / 2; half > 0; i++, half /= 2) side->own[k] += k & half ? steps[i] : -steps[i];
    }
}

static inline void take_side(int n, const double *step, Side *side) {
    side->n = n;
    side->step = step;
}

/* From the squared length, as most sides need no root. */
static inline void find_side(double square, const Reader *reader, Side *side) {
    double less = squared(WELL_BELOW) * square;
    if (square < squared(WELL_BELOW * POINT_SIDE)) take_side(1, ONE, side);
    else if (less > squared(2 * POINT_SIDE) && square < squared(WELL_BELOW * 2 * SIDE)) take_side(2, TWO, side);
    else if (less > squared((2 + APART) * SIDE) && square < squared(WELL_BELOW * 4 * SIDE))
        take_side(reader->four.n, reader->four.own, side);
    else if (less > squared(2 * (2 + APART) * SIDE)) take_side(reader->eight.n, reader->eight.own, side);
    else find_own_side(sqrt(square), side);
}

/* The variance along each axis left to smaller sizes of the picture, for each of the most reads; it is removed from
   the sides. `square`: squared length of the shorter side. */
static double leave_to_levels(double *first, double *second, double square) {
    if (square < squared(WELL_BELOW * SIDE * MOST_READS)) return 0;
    double each = sqrt(square) / MOST_READS, left = (each * each - SIDE * SIDE) / 12;
    if (!(left > 0)) return 0;
    double of_first = first[0] * first[0] + first[1] * first[1], of_second = second[0] * second[0] + second[1] * second[1];
    double area = first[0] * second[1] - first[1] * second[0], both = of_first + of_second;
    double most = 0.75 * area * area / (both > LEAST ? both : LEAST);
    if (most < left) left = most;
    if (!(left > 0)) return 0;
    double scale = left / (area * area), askew = scale * (first[0] * second[0] + first[1] * second[1]);
    double reach = sqrt(1 - scale * of_second), along = askew / reach;
    double across = sqrt(1 - scale * of_first - along * along);
    for (int k = 0; k < 2; k++) {
        first[k] = reach * first[k] + along * second[k];
        second[k] = across * second[k];
    }
    return left;
}

/* Read a share at as many places as its sides need. */
static Tap *read_share(const Reader *reader, const Footprint *f, Tap *tap) {
    double first[2] = {f->first[0], f->first[1]}, second[2] = {f->second[0], f->second[1]};
    double length = 12 * (first[0] * first[0] + first[1] * first[1]); /* both squared */
    double width = 12 * (second[0] * second[0] + second[1] * second[1]);
    Side along, across;
    find_side(length, reader, &along);
    find_side(width, reader, &across);
    Mix mix = find_mix(reader, leave_to_levels(first, second, length < width ? length : width));
    double weight = f->weight / (along.n * across.n);
    for (int i = 0; i < along.n; i++) {
        double x = f->at[0] + along.step[i] * first[0], y = f->at[1] + along.step[i] * first[1];
        for (int j = 0; j < across.n; j++)
            tap = read_place(reader, mix, x + across.step[j] * second[0], y + across.step[j] * second[1], weight, tap);
    }
    return tap;
}

/* Add the values of some taps, in order, to a display pixel. */
static inline void add_taps(const Level *levels, const Tap *taps, int64_t n, double *total, int64_t n_pixels) {
    double red = total[0], green = total[n_pixels], blue = total[2 * n_pixels];
    for (const Tap *tap = taps; tap < taps + n; tap++) {
        const Level *level = levels + tap->level;
        const float *upper = level->pixels + tap->row * level->stride + 4 * (int64_t)tap->column;
        const float *lower = level->height > 1 ? upper + level->stride : upper;
        int64_t right = level->width > 1 ? 4 : 0;
        Colour colour = tap->weight[0] * *(const Colour *)upper;
        colour += tap->weight[1] * *(const Colour *)(upper + right);
        colour += tap->weight[2] * *(const Colour *)lower;
        colour += tap->weight[3] * *(const Colour *)(lower + right);
        red += (double)colour[0];
        green += (double)colour[1];
        blue += (double)colour[2];
    }
    total[0] = red;
    total[n_pixels] = green;
    total[2 * n_pixels] = blue;
}

/* Shares to be painted. */
typedef struct {
    const FlatTaps *shares;
    Reader reader;
    double *total;
    int64_t n_pixels;
    KeptTaps *kept;  /* NULL for none */
} Canvas;

/* Store the taps of a pixel. */
static void keep(KeptTaps *kept, int64_t stripe, int64_t pixel, const Tap *taps, int64_t n) {
    int64_t before = kept->n[stripe], room = kept->room[stripe];
    if (room < 0) return;
    if (before + n > room) {
        room = 2 * (before + n);
        Tap *moved = realloc(kept->taps[stripe], sizeof(Tap) * (size_t)room);
        kept->room[stripe] = moved ? room : -1;
        if (!moved) return;
        kept->taps[stripe] = moved;
    }
    for (int64_t i = 0; i < n; i++) {
        kept->taps[stripe][before + i] = taps[i];
        kept->taps[stripe][before + i].pixel = (int32_t)pixel;
    }
    kept->n[stripe] = before + n;
}

/* Process the shares in some stripes of display pixels, in order for each pixel. */
static void go_through_stripes(void *context, int64_t first, int64_t last) {
    const Canvas *canvas = context;
    const FlatTaps *shares = canvas->shares;
    int64_t n_pixels = canvas->n_pixels;
    for (int64_t i = 0; i < shares->n; i++) {
        int64_t pixel = shares->pixel ? shares->pixel[i] : shares->wide_pixel[i];
        if (pixel < 0 || pixel >= n_pixels) continue;
        int64_t stripe = pixel / STRIPE % N_STRIPES;
        Footprint footprint;
        if (stripe < first || stripe >= last || !find_footprint(shares, i, &footprint)) continue;
        Tap taps[MOST_TAPS]; /* only set before `end` */
        const Tap *end = read_share(&canvas->reader, &footprint, taps);
        add_taps(canvas->reader.levels, taps, end - taps, canvas->total + pixel, n_pixels);
        if (canvas->kept) keep(canvas->kept, stripe, pixel, taps, end - taps);
    }
}

/* Work on a few stripes at a time. */
static void share_stripes(void (*work)(void *, int64_t, int64_t), void *context, int64_t n_threads) {
    if (n_threads < 1) n_threads = 1;
    int64_t at_once = n_threads < N_STRIPES ? (N_STRIPES + n_threads - 1) / n_threads : 1;
    share_out(work, context, N_STRIPES, at_once, n_threads);
}

/* Add area * throughput * colour of shares to the sums (3, n_pixels) of display pixels. The result does not depend
   on the number of threads. `kept` takes the taps, unless it is NULL. */
KIRIKO_API void kiriko_paint(const FlatTaps *shares, const Level *levels, int64_t n_levels, double *total,
                             int64_t n_pixels, KeptTaps *kept, int64_t n_threads) {
    Canvas canvas = {.shares = shares, .total = total, .n_pixels = n_pixels, .kept = kept};
    Reader *reader = &canvas.reader;
    reader->levels = levels;
    reader->n_levels = n_levels < MOST_LEVELS ? n_levels : MOST_LEVELS;
    for (int64_t k = 0; k < reader->n_levels; k++) {
        const int64_t size[2] = {levels[k].width, levels[k].height};
        for (int a = 0; a < 2; a++) {
            reader->grids[k].scale[a] = (double)size[a] / shares->size[a];
            reader->grids[k].most[a] = (double)(size[a] - 1);
            reader->grids[k].last[a] = size[a] > 1 ? (int32_t)(size[a] - 2) : 0;
        }
    }
    find_own_side(3 * SIDE, &reader->four);
    find_own_side(6 * SIDE, &reader->eight);
    if (reader->n_levels > 0) share_stripes(go_through_stripes, &canvas, n_threads);
    for (int64_t k = 0; kept && k < N_STRIPES; k++) {
        Tap *fitted = kept->n[k] ? realloc(kept->taps[k], sizeof(Tap) * (size_t)kept->n[k]) : NULL;
        if (fitted) kept->taps[k] = fitted;
    }
}

/* Taps painted again. */
typedef struct {
    const KeptTaps *kept;
    const Level *levels;
    double *total;
    int64_t n_pixels;
} Repainted;

static void repaint_stripes(void *context, int64_t first, int64_t last) {
    const Repainted *of = context;
    for (int64_t k = first; k < last; k++) {
        const Tap *taps = of->kept->taps[k];
        for (int64_t i = 0; i < of->kept->n[k]; i++)
            add_taps(of->levels, taps + i, 1, of->total + taps[i].pixel, of->n_pixels);
    }
}

/* As kiriko_paint, with the same bits. */
KIRIKO_API void kiriko_repaint(const KeptTaps *kept, const Level *levels, double *total, int64_t n_pixels,
                               int64_t n_threads) {
    Repainted of = {.kept = kept, .levels = levels, .total = total, .n_pixels = n_pixels};
    share_stripes(repaint_stripes, &of, n_threads);
}

KIRIKO_API void kiriko_free_taps(KeptTaps *kept) {
    for (int k = 0; k < N_STRIPES; k++) free(kept->taps[k]);
}
