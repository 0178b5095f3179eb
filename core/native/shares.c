/* Divides cells among the display's pixels, cell by cell. The numpy reference is core/map/rasterise.py. */

#include <float.h>

#include "kiriko.h"

#define THINNEST 1e-5   /* as in cells.py, as are all up to FARTHEST */
#define SMALLEST 1e-14
#define LEVEL 1e-100
#define INSIDE 1e-9
#define FARTHEST 1e15
#define COLUMNS_AT_ONCE 256 /* of a row: edges further left count as on their border, for rows of any length */

/* A triangle or quad on the display and its image on the viewer's image. */
typedef struct {
    int k;
    double x[4], y[4], u[4], v[4];
} Cell;

/* A cell that crosses grid lines, relative to the corner (x0, y0) of its window of pixels. */
typedef struct {
    int k;
    double x[4], y[4], slope[4];
    double total, view_area, display_area;
    int64_t x0, y0, columns, rows;
    double inverse[8], forward[8]; /* from the display to s, t in the cell, and on to u, v */
} Crossing;

/* The part of an edge in a row. */
typedef struct {
    double xa, ya, xb, yb;
} Edge;

/* Sums over the edges in a pixel: vertical extent with moments of y, and area on their left with moments. */
typedef struct {
    double cover, cover_y, cover_yy, area, x, y, xx, xy, yy;
} Sums;

/* Floor of a number within the range of int64. */
static inline double whole_below(double number) {
    double whole = (double)(int64_t)number;
    return whole > number ? whole - 1 : whole;
}

static inline double least(const double *a, int k) {
    double found = a[0];
    for (int i = 1; i < k; i++) found = a[i] < found ? a[i] : found;
    return found;
}

static inline double greatest(const double *a, int k) {
    double found = a[0];
    for (int i = 1; i < k; i++) found = a[i] > found ? a[i] : found;
    return found;
}

static inline double cross_2(double ax, double ay, double bx, double by) { return ax * by - ay * bx; }

static inline float to_float(double number) {
    return number > FLT_MAX ? INFINITY : number < -FLT_MAX ? -INFINITY : (float)number;
}

static double signed_area(const double *x, const double *y, int k) {
    if (k == 3) return 0.5 * cross_2(x[1] - x[0], y[1] - y[0], x[2] - x[0], y[2] - y[0]);
    return 0.5 * cross_2(x[2] - x[0], y[2] - y[0], x[3] - x[1], y[3] - y[1]);
}

static void find_centroid(const double *x, const double *y, int k, double *place) {
    if (k == 3) {
        place[0] = (x[0] + x[1] + x[2]) / 3;
        place[1] = (y[0] + y[1] + y[2]) / 3;
        return;
    }
    double dx[3], dy[3];
    for (int i = 0; i < 3; i++) {
        dx[i] = x[i + 1] - x[0];
        dy[i] = y[i + 1] - y[0];
    }
    double first = cross_2(dx[0], dy[0], dx[1], dy[1]), second = cross_2(dx[1], dy[1], dx[2], dy[2]);
    second /= first + second;
    place[0] = x[0] + (dx[0] + dx[1] + second * (dx[2] - dx[0])) / 3;
    place[1] = y[0] + (dy[0] + dy[1] + second * (dy[2] - dy[0])) / 3;
}

/* Covariance of points in a triangle, or in a quad treated as a parallelogram. */
static void find_covariance(const double *x, const double *y, int k, double *covariance) {
    if (k == 3) {
        double ax = x[1] - x[0], ay = y[1] - y[0], bx = x[2] - x[0], by = y[2] - y[0];
        covariance[0] = (ax * ax + bx * bx - ax * bx) / 18;
        covariance[1] = (ax * ay + bx * by - 0.5 * (ax * by + ay * bx)) / 18;
        covariance[2] = (ay * ay + by * by - ay * by) / 18;
        return;
    }
    double ax = x[2] - x[0], ay = y[2] - y[0], bx = x[3] - x[1], by = y[3] - y[1];
    covariance[0] = (ax * ax + bx * bx) / 24;
    covariance[1] = (ax * ay + bx * by) / 24;
    covariance[2] = (ay * ay + by * by) / 24;
}

static void put_share(Division *d, int64_t pixel, const double *place, const double *covariance, double area,
                      double display_area) {
    int64_t n = d->n++;
    if (d->pixel) d->pixel[n] = (int32_t)pixel;
    else d->wide_pixel[n] = pixel;
    d->view_xy[2 * n] = place[0];
    d->view_xy[2 * n + 1] = place[1];
    for (int i = 0; i < 3; i++) d->covariance[i * d->room + n] = to_float(covariance[i]);
    d->area[n] = area;
    d->display_area[n] = display_area;
    if (d->number) d->number[n] = d->cell;
}

static bool is_seen(const Division *d, const Cell *cell) {
    for (int i = 0; i < cell->k; i++) {
        if (!(cell->x[i] > -FARTHEST && cell->x[i] < FARTHEST)) return false;
        if (!(cell->y[i] > -FARTHEST && cell->y[i] < FARTHEST)) return false;
    }
    double view_area = fabs(signed_area(cell->u, cell->v, cell->k));
    return greatest(cell->x, cell->k) >= 0 && least(cell->x, cell->k) < (double)d->width &&
           greatest(cell->y, cell->k) >= 0 && least(cell->y, cell->k) < (double)d->height &&
           view_area > 0 && view_area < INFINITY;
}

/* Signed area of the triangle at each corner of a quad. */
static void find_corner_areas(const Cell *quad, double *areas) {
    for (int i = 0; i < 4; i++) {
        int before = (i + 3) % 4, after = (i + 1) % 4;
        areas[i] = 0.5 * cross_2(quad->x[i] - quad->x[before], quad->y[i] - quad->y[before],
                                 quad->x[after] - quad->x[i], quad->y[after] - quad->y[i]);
    }
}

/* Whether the bilinear map of a quad has one orientation everywhere. */
static bool is_unfolded(const Cell *quad, const double *areas) {
    double width = greatest(quad->x, 4) - least(quad->x, 4), height = greatest(quad->y, 4) - least(quad->y, 4);
    double turn = least(areas, 4), other = -greatest(areas, 4);
    return (turn > other ? turn : other) > 0.5 * THINNEST * (width > height ? width : height);
}

/* One of two triangles of a quad, by the diagonal with the smaller ones. */
static void unfold(const Cell *quad, const double *areas, int which, Cell *triangle) {
    int turn = fabs(areas[0]) + fabs(areas[2]) < fabs(areas[1]) + fabs(areas[3]);
    triangle->k = 3;
    for (int i = 0; i < 3; i++) {
        int from = (2 * which + i + turn) % 4;
        triangle->x[i] = quad->x[from];
        triangle->y[i] = quad->y[from];
        triangle->u[i] = quad->u[from];
        triangle->v[i] = quad->v[from];
    }
}

/* Widen a triangle degenerated to a line or point beyond rounding errors. */
static void thicken(double *x, double *y) {
    double longest = -1;
    int start = 0;
    for (int i = 0; i < 3; i++) {
        double dx = x[(i + 1) % 3] - x[i], dy = y[(i + 1) % 3] - y[i], length = sqrt(dx * dx + dy * dy);
        if (length > longest) {
            longest = length;
            start = i;
        }
    }
    bool is_point = longest < THINNEST;
    if (!is_point && !(2 * fabs(signed_area(x, y, 3)) < THINNEST * longest)) return;

    int end = (start + 1) % 3, apex = (start + 2) % 3;
    double along_x = is_point ? 0.0 : x[end] - x[start], along_y = is_point ? THINNEST : y[end] - y[start];
    double length = sqrt(along_x * along_x + along_y * along_y);
    along_x /= length;
    along_y /= length;
    double reach = (x[apex] - x[start]) * along_x + (y[apex] - y[start]) * along_y;
    double side = THINNEST * (along_y > 0 || (along_y == 0 && along_x < 0) ? 1.0 : -1.0);
    x[end] = x[start] + length * along_x;
    y[end] = y[start] + length * along_y;
    x[apex] = x[start] + reach * along_x + side * along_y;
    y[apex] = y[start] + reach * along_y - side * along_x;
}

/* Constant, s, t and s t coefficients of the map from s, t in -1/2..1/2 to a quad. */
static void find_bilinear(const double *x, double *terms) {
    terms[0] = 0.25 * (x[0] + x[1] + x[2] + x[3]);
    terms[1] = 0.5 * (x[1] + x[2] - x[0] - x[3]);
    terms[2] = 0.5 * (x[2] + x[3] - x[0] - x[1]);
    terms[3] = x[0] - x[1] + x[2] - x[3];
}

/* The same for s, t in 0..1 and a triangle. */
static void find_linear(const double *x, double *terms) {
    terms[0] = x[0];
    terms[1] = x[1] - x[0];
    terms[2] = x[2] - x[0];
    terms[3] = 0;
}

static void find_maps(Crossing *c, const Cell *cell) {
    void (*find_terms)(const double *, double *) = c->k == 3 ? find_linear : find_bilinear;
    double x[4], y[4];
    find_terms(c->x, x);
    find_terms(c->y, y);
    find_terms(cell->u, c->forward);
    find_terms(cell->v, c->forward + 4);
    double det = c->k == 3 ? 2 * c->total : c->total;
    double s_x = y[2] / det, s_y = -x[2] / det, t_x = -y[1] / det, t_y = x[1] / det;
    const double inverse[8] = {
        s_x, s_y, -(s_x * x[0] + s_y * y[0]), t_x,
        t_y, -(t_x * x[0] + t_y * y[0]), s_x * x[3] + s_y * y[3], t_x * x[3] + t_y * y[3],
    };
    for (int i = 0; i < 8; i++) c->inverse[i] = inverse[i];
}

static void find_crossing(const Division *d, const Cell *cell, Crossing *c) {
    double width = (double)d->width, height = (double)d->height;
    int k = c->k = cell->k;
    for (int i = 0; i < k; i++) {
        c->x[i] = cell->x[i];
        c->y[i] = cell->y[i];
    }
    c->view_area = fabs(signed_area(cell->u, cell->v, k));
    c->display_area = fabs(signed_area(c->x, c->y, k));
    if (k == 3) thicken(c->x, c->y);

    /* all are less than FARTHEST */
    double x0 = clip(whole_below(least(c->x, k)), 0, width - 1), y0 = clip(whole_below(least(c->y, k)), 0, height - 1);
    c->x0 = (int64_t)x0;
    c->y0 = (int64_t)y0;
    c->columns = (int64_t)clip(-whole_below(-greatest(c->x, k)), x0 + 1, width) - c->x0;
    c->rows = (int64_t)clip(-whole_below(-greatest(c->y, k)), y0 + 1, height) - c->y0;
    for (int i = 0; i < k; i++) {
        c->x[i] -= x0;
        c->y[i] -= y0;
    }
    c->total = signed_area(c->x, c->y, k);
    for (int i = 0; i < k; i++) {
        int j = (i + 1) % k;
        double dy = c->y[j] - c->y[i];
        c->slope[i] = (c->x[j] - c->x[i]) / (fabs(dy) < LEVEL ? 1.0 : dy);
    }
    find_maps(c, cell);
}

/* Clip an outline to a row; returns the number of edges in it, and the first and last column they enter. */
static int find_edges(const Crossing *c, int64_t row, Edge *edges, double *first, double *last) {
    double off[4], inside[4], low = INFINITY, high = -INFINITY, last_column = (double)(c->columns - 1);
    int n = 0;
    for (int i = 0; i < c->k; i++) {
        double y = c->y[i] - (double)row;
        inside[i] = clip(y, 0, 1);
        off[i] = inside[i] - y;
    }
    for (int i = 0; i < c->k; i++) {
        int j = (i + 1) % c->k;
        if (inside[i] == inside[j]) continue;
        Edge *edge = edges + n++;
        /* rounded to multiples of 2^-51 or coarser, so distances to a grid line are exact, even just left of 0 */
        edge->xa = (c->x[i] + off[i] * c->slope[i] + 4) - 4;
        edge->xb = (c->x[j] + off[j] * c->slope[i] + 4) - 4;
        edge->ya = inside[i];
        edge->yb = inside[j];
        double left = edge->xa < edge->xb ? edge->xa : edge->xb, right = edge->xa < edge->xb ? edge->xb : edge->xa;
        if (left < low) low = left;
        if (right > high) high = right;
    }
    *first = whole_below(clip(low, 0, last_column));
    *last = clip(-whole_below(-clip(high, -1, last_column + 1)) - 1, *first, last_column);
    return n;
}

/* Add a piece of an edge to its pixel, by Green's theorem; its ends are relative to the pixel's upper left corner. */
static inline void add_piece(Sums *sums, double xa, double ya, double xb, double yb) {
    double dy = yb - ya, xs = xa + xb, ys = ya + yb;
    double xx = xa * xa + xb * xb, xy = xa * ya + xb * yb, yy = ya * ya + yb * yb;
    sums->cover += dy;
    sums->cover_y += dy * ys * 0.5;
    sums->cover_yy += dy * (ys * ys + yy) * (1.0 / 6);
    sums->area += dy * xs * 0.5;
    sums->x += dy * (xs * xs + xx) * (1.0 / 12);
    sums->y += dy * (xs * ys + xy) * (1.0 / 6);
    sums->xx += dy * xs * xx * (1.0 / 12);
    sums->xy += dy * (xx * ys + 2 * xs * xy) * (1.0 / 24);
    sums->yy += dy * (xs * yy + 2 * ys * xy) * (1.0 / 12);
}

/* Add an edge to n pixels from a column on: further left it counts as on their border, further right as nothing. */
static void add_edge(const Edge *edge, double column, int64_t n, Sums *sums) {
    double xa = edge->xa - column, xb = edge->xb - column, ya = edge->ya, yb = edge->yb;
    double low = xa < xb ? xa : xb, high = xa < xb ? xb : xa, first = (double)(int64_t)low;
    if (low >= 0 && high <= first + 1 && low < (double)n) { /* within one pixel */
        add_piece(sums + (int64_t)low, xa - first, ya, xb - first, yb);
        return;
    }
    double slope = (yb - ya) / (edge->xb - edge->xa + (edge->xa == edge->xb));
    if (low < 0) {
        double from = xa > 0 ? ya - xa * slope : ya, to = xb > 0 ? yb - xb * slope : yb;
        add_piece(sums, 0, from, 0, to);
    }
    int64_t begin = (int64_t)clip(low, 0, (double)n), end = high < 0 ? -1 : (int64_t)clip(high, 0, (double)(n - 1));
    for (int64_t i = begin; i <= end; i++) {
        double a = xa - (double)i, b = xb - (double)i, a_in = clip(a, 0, 1), b_in = clip(b, 0, 1);
        add_piece(sums + i, a_in, ya + (a_in - a) * slope, b_in, yb + (b_in - b) * slope);
    }
}

/* The place on the viewer's image of a point of the display within its cell. */
static void find_place(const Crossing *c, double x, double y, double *place) {
    const double *to = c->inverse, *f = c->forward;
    double s = to[0] * x + to[1] * y + to[2], t = to[3] * x + to[4] * y + to[5], cx = to[6], cy = to[7];
    if (c->k == 3) {
        s = clip(s, INSIDE, 1 - 2 * INSIDE);
        t = clip(t, INSIDE, 1 - INSIDE - s);
    } else {
        /* with k = s t: k = (s - k cx) (t - k cy), a quadratic equation */
        double linear = 1 + s * cy + t * cx, root = linear * linear - 4 * cx * cy * s * t;
        double whole = linear + (root > 0 ? sqrt(root) : 0), k = 2 * s * t / (whole > THINNEST ? whole : THINNEST);
        s = clip(s - k * cx, INSIDE - 0.5, 0.5 - INSIDE);
        t = clip(t - k * cy, INSIDE - 0.5, 0.5 - INSIDE);
    }
    double k = s * t;
    place[0] = f[0] + s * f[1] + t * f[2] + k * f[3];
    place[1] = f[4] + s * f[5] + t * f[6] + k * f[7];
}

/* Covariance of points mapped by a matrix, row by row. */
static inline void turn(const double *m, const double *from, double *to) {
    double xx = from[0], xy = from[1], yy = from[2];
    to[0] = m[0] * m[0] * xx + 2 * m[0] * m[1] * xy + m[1] * m[1] * yy;
    to[1] = m[0] * m[2] * xx + (m[0] * m[3] + m[1] * m[2]) * xy + m[1] * m[3] * yy;
    to[2] = m[2] * m[2] * xx + 2 * m[2] * m[3] * xy + m[3] * m[3] * yy;
}

/* Map a covariance from the display to the viewer's image, limited in between to possible values for the cell. */
static void find_spread(const Crossing *c, double xx, double xy, double yy, double *covariance) {
    const double to_cell[4] = {c->inverse[0], c->inverse[1], c->inverse[3], c->inverse[4]};
    const double to_view[4] = {c->forward[1], c->forward[2], c->forward[5], c->forward[6]};
    const double on_display[3] = {xx, xy, yy};
    double in_cell[3];
    turn(to_cell, on_display, in_cell);
    in_cell[0] = clip(in_cell[0], 0, 0.25);
    in_cell[2] = clip(in_cell[2], 0, 0.25);
    double most = sqrt(in_cell[0] * in_cell[2]);
    in_cell[1] = clip(in_cell[1], -most, most);
    turn(to_view, in_cell, covariance);
}

/* Store the shares of n pixels of a row from a column on; their sums are relative to the left of the cell or its
   window. */
static void put_shares(Division *d, const Crossing *c, int64_t row, int64_t column, int64_t n, const Sums *sums) {
    int64_t pixel = (c->y0 + row) * d->width + c->x0 + column;
    double cover = 0, cover_y = 0, cover_yy = 0;
    for (int64_t i = 0; i < n; i++) {
        const Sums *here = sums + i;
        cover += here->cover;
        cover_y += here->cover_y;
        cover_yy += here->cover_yy;
        double area = here->area - cover, share = area / c->total;
        if (!(share > SMALLEST && share < INFINITY)) continue;
        double each = 1 / area;
        double x = clip((here->x - 0.5 * cover) * each, 0, 1), y = clip((here->y - cover_y) * each, 0, 1);
        double xx = (here->xx - (1.0 / 3) * cover) * each - x * x;
        double xy = (here->xy - 0.5 * cover_y) * each - x * y;
        double yy = (here->yy - cover_yy) * each - y * y;
        double place[2], covariance[3];
        find_place(c, (double)(column + i) + x, (double)row + y, place);
        find_spread(c, xx, xy, yy, covariance);
        put_share(d, pixel + i, place, covariance, share * c->view_area, share * c->display_area);
    }
}

/* Divide a cell that crosses grid lines, from d->row and d->column on; false if the buffer is full. */
static bool spread(Division *d, const Cell *cell) {
    Crossing c;
    find_crossing(d, cell, &c);
    int64_t at_once = d->room < COLUMNS_AT_ONCE ? d->room : COLUMNS_AT_ONCE;
    Sums sums[COLUMNS_AT_ONCE];
    for (; d->row < c.rows; d->row++, d->column = 0) {
        Edge edges[4];
        double first, last;
        int n_edges = find_edges(&c, d->row, edges, &first, &last);
        int64_t begin = (int64_t)first, n_columns = (int64_t)last + 1 - begin;
        if (n_edges == 0) continue;
        while (d->column < n_columns) {
            int64_t left = n_columns - d->column, n = left < at_once ? left : at_once;
            if (d->n + n > d->room) return false;
            for (int64_t i = 0; i < n; i++) sums[i] = (Sums){0};
            for (int i = 0; i < n_edges; i++) add_edge(edges + i, (double)(begin + d->column), n, sums);
            put_shares(d, &c, d->row, begin + d->column, n, sums);
            d->column += n;
        }
    }
    d->row = 0;
    return true;
}

/* Divide a cell, continuing after a full buffer; false if the buffer is full again. */
static bool divide(Division *d, const Cell *cell) {
    if (!is_seen(d, cell)) return true;
    double column = whole_below(least(cell->x, cell->k)), row = whole_below(least(cell->y, cell->k));
    /* a right or lower edge on a grid line touches the next pixel without entering it */
    if (greatest(cell->x, cell->k) <= column + 1 && greatest(cell->y, cell->k) <= row + 1 && column >= 0 && row >= 0) {
        if (d->n == d->room) return false;
        double place[2], covariance[3];
        find_centroid(cell->u, cell->v, cell->k, place);
        find_covariance(cell->u, cell->v, cell->k, covariance);
        put_share(d, (int64_t)row * d->width + (int64_t)column, place, covariance,
                  fabs(signed_area(cell->u, cell->v, cell->k)), fabs(signed_area(cell->x, cell->y, cell->k)));
        return true;
    }
    if (cell->k == 3) return spread(d, cell);
    double areas[4];
    find_corner_areas(cell, areas);
    if (is_unfolded(cell, areas)) return spread(d, cell);
    for (; d->part < 2; d->part++) {
        Cell triangle;
        unfold(cell, areas, (int)d->part, &triangle);
        if (!divide(d, &triangle)) return false;
    }
    d->part = 0;
    return true;
}

/* Divide cells from d->cell on, until all are done or the buffer is full. */
static void divide_lot(Division *d) {
    int k = d->n_corners == 3 ? 3 : 4;
    for (; d->cell < d->n_cells; d->cell++) {
        Cell cell = {.k = k};
        for (int i = 0; i < k; i++) {
            const double *view = d->view + 2 * (d->cell * k + i), *display = d->display + 2 * (d->cell * k + i);
            cell.u[i] = view[0];
            cell.v[i] = view[1];
            cell.x[i] = display[0];
            cell.y[i] = display[1];
        }
        if (!divide(d, &cell)) return;
    }
}

static void divide_lots(void *lots, int64_t first, int64_t last) {
    for (int64_t i = first; i < last; i++) divide_lot((Division *)lots + i);
}

/* Start dividing lots of cells, each up to the capacity of its buffer, in n_threads - 1 other threads. NULL if
   memory is short; else call kiriko_end before any other access to the lots. */
KIRIKO_API Begun *kiriko_begin_division(Division *lots, int64_t n_lots, int64_t n_threads) {
    return begin_work(divide_lots, lots, n_lots, n_threads);
}

/* Divide lots of cells, each up to the capacity of its buffer, in this thread. */
KIRIKO_API void kiriko_divide(Division *lots, int64_t n_lots) { divide_lots(lots, 0, n_lots); }

/* Places count for the pixel around them, or the nearest one. */
static void add_sum(const Sum *sum) {
    double *image = sum->image;
    int64_t width = sum->width, height = sum->height, n_pixels = width * height;
    if (n_pixels <= 0) return; /* NaN has no nearest pixel */
    for (int64_t i = 0; i < sum->n && !sum->places; i++) {
        int64_t pixel = sum->pixel ? sum->pixel[i] : sum->wide_pixel[i];
        if (pixel >= 0 && pixel < n_pixels) image[pixel] += sum->weights[i];
    }
    for (int64_t i = 0; i < sum->n && sum->places; i++) {
        int64_t column = (int64_t)clip(sum->places[2 * i], 0, (double)(width - 1));
        int64_t row = (int64_t)clip(sum->places[2 * i + 1], 0, (double)(height - 1));
        image[row * width + column] += sum->weights[i];
    }
}

static void add_sums(void *sums, int64_t first, int64_t last) {
    for (int64_t i = first; i < last; i++) add_sum((const Sum *)sums + i);
}

/* Add weights to several images, each in one of the threads. */
KIRIKO_API void kiriko_add(Sum *sums, int64_t n_sums, int64_t n_threads) {
    share_out(add_sums, sums, n_sums, 1, n_threads > 1 ? n_threads : 1);
}

/* Extent of a polygon of k corners on both sides of a line; a corner closer than `on_line` is on it. */
static void find_reach(const double *corners, int64_t k, const double *line, double on_line, double *least,
                       double *most) {
    *least = INFINITY;
    *most = -INFINITY;
    for (int64_t j = 0; j < k; j++) {
        double side = line[0] * corners[2 * j] + line[1] * corners[2 * j + 1] + line[2];
        if (fabs(side) < on_line) side = 0;
        if (side < *least) *least = side;
        if (side > *most) *most = side;
    }
}

/* Find polygons (n, k, 2) that cross an outline of lines (l, 3), as in core/image/outline.py; returns their number. */
KIRIKO_API int64_t kiriko_find_across(const double *polygons, int64_t n, int64_t k, const double *lines,
                                      int64_t n_lines, double on_line, int64_t *found) {
    int64_t n_found = 0;
    for (int64_t i = 0; i < n; i++) {
        bool is_across = false, is_beside = false;
        for (int64_t l = 0; l < n_lines && !is_beside; l++) {
            double least, most;
            find_reach(polygons + 2 * k * i, k, lines + 3 * l, on_line, &least, &most);
            is_beside = most <= 0;
            is_across |= least < 0 && most > 0;
        }
        if (is_across && !is_beside) found[n_found++] = i;
    }
    return n_found;
}
