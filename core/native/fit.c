/* Fits curved faces, vertex by vertex and face by face. The numpy reference is core/glass/fitted_faces.py and
   core/glass/surface_fit.py. */

#include <string.h>

#include "kiriko.h"

#define FITTED_AT_ONCE 256 /* vertices or faces, as in native_fit.py */
#define N_NODES 12
#define LEAST_UPRIGHT 0.2 /* as in fitted_faces.py, like the next */
#define LEAST_DISTANCE 1e-12
#define STEPS 2 /* as in fitted_faces.py */

static const int POWERS[N_TERMS][2] = {{1, 0}, {0, 1}, {2, 0}, {1, 1}, {0, 2}, {3, 0}, {2, 1},
                                       {1, 2}, {0, 3}, {4, 0}, {3, 1}, {2, 2}, {1, 3}, {0, 4}};

/* A neighbour's data for a vertex's height field: its height, z, and its slopes by x and y, from its normal. */
typedef struct {
    double terms[3][N_TERMS], weights[3], z;
} Neighbour;

static void find_terms(double x, double y, double terms[3][N_TERMS]) {
    const double px[5] = {1, x, x * x, x * x * x, (x * x) * (x * x)};
    const double py[5] = {1, y, y * y, y * y * y, (y * y) * (y * y)};
    for (int k = 0; k < N_TERMS; k++) {
        int a = POWERS[k][0], b = POWERS[k][1];
        terms[0][k] = px[a] * py[b];
        terms[1][k] = a * px[a > 0 ? a - 1 : 0] * py[b];
        terms[2][k] = b * px[a] * py[b > 0 ? b - 1 : 0];
    }
}

static void read_neighbour(const Fit *f, int64_t vertex, int64_t end, Neighbour *neighbour) {
    double away[3];
    for (int j = 0; j < 3; j++) away[j] = (f->at[3 * end + j] - f->at[3 * vertex + j]) / f->size[vertex];
    double distance = dot(away, away), used = f->is_known[end];
    find_terms(dot(away, f->axis_x + 3 * vertex), dot(away, f->axis_y + 3 * vertex), neighbour->terms);
    neighbour->z = dot(away, f->normal + 3 * vertex);
    neighbour->weights[0] = used * (2 / sqrt(distance > LEAST_DISTANCE ? distance : LEAST_DISTANCE));
    neighbour->weights[1] = neighbour->weights[2] = used;
    if (!f->is_rim[vertex]) return;
    if (f->is_rim[end]) neighbour->weights[2] = 0;
    for (int r = 0; r < 3; r++) neighbour->terms[r][N_TERMS - 1] = 0; /* y^4 */
}

/* Slopes by x and y, in the frame of a vertex, of a surface with this normal. */
static void find_slopes(const Fit *f, int64_t vertex, const double *normal, double *slopes) {
    double upright = dot(normal, f->normal + 3 * vertex);
    if (upright < LEAST_UPRIGHT) upright = LEAST_UPRIGHT;
    slopes[0] = -dot(normal, f->axis_x + 3 * vertex) / upright;
    slopes[1] = -dot(normal, f->axis_y + 3 * vertex) / upright;
}

/* Add a neighbour's data to the upper half of the normal matrix, for the terms from `first` on, in rows of `width`. */
static void add_neighbour(const Neighbour *neighbour, int first, int width, double *matrix, double *scale) {
    int k = N_TERMS - first;
    for (int r = 0; r < 3; r++) {
        double row[N_TERMS];
        for (int i = 0; i < k; i++) row[i] = neighbour->terms[r][first + i] * neighbour->weights[r];
        for (int i = 0; i < k; i++)
            for (int j = i; j < k; j++) matrix[i * width + j] += row[i] * row[j];
        *scale += neighbour->weights[r] * neighbour->weights[r];
    }
}

static void add_ridge(const Fit *f, int first, int width, double scale, double *matrix) {
    for (int i = 0; i < N_TERMS - first; i++) matrix[i * width + i] += f->ridge[first + i] * scale;
}

/* Solve k symmetric equations by elimination; right sides follow the matrix in each row and become the solutions. */
static void solve(double *a, int k, int width) {
    for (int i = 0; i < k; i++) {
        double *row = a + i * width, pivot_row[N_TERMS];
        for (int j = i + 1; j < k; j++) pivot_row[j] = row[j];
        for (int j = i + 1; j < width; j++) row[j] /= row[i];
        for (int r = i + 1; r < k; r++)
            for (int j = r; j < width; j++) a[r * width + j] -= pivot_row[r] * row[j];
    }
    for (int i = k - 2; i >= 0; i--)
        for (int r = i + 1; r < k; r++)
            for (int j = k; j < width; j++) a[i * width + j] -= a[i * width + r] * a[r * width + j];
}

typedef struct {
    const Fit *fit;
    double *coefficients;
} Fields;

#define FREE (N_TERMS - 2) /* terms of a field with the vertex's own slope */

static void fit_some_fields(void *context, int64_t first, int64_t last) {
    const Fields *fields = context;
    const Fit *f = fields->fit;
    for (int64_t n = first; n < last; n++) {
        int64_t vertex = f->wanted[n];
        double a[FREE * (FREE + 1)] = {0}, scale = 1;
        for (int64_t p = f->first[vertex]; p < f->first[vertex + 1]; p++) {
            Neighbour neighbour;
            read_neighbour(f, vertex, f->end[p], &neighbour);
            add_neighbour(&neighbour, 2, FREE + 1, a, &scale);
            double values[3] = {neighbour.z};
            find_slopes(f, vertex, f->normal + 3 * f->end[p], values + 1);
            for (int r = 0; r < 3; r++)
                for (int i = 0; i < FREE; i++)
                    a[i * (FREE + 1) + FREE] +=
                        neighbour.terms[r][2 + i] * neighbour.weights[r] * (values[r] * neighbour.weights[r]);
        }
        add_ridge(f, 2, FREE + 1, scale, a);
        solve(a, FREE, FREE + 1);
        for (int i = 0; i < FREE; i++) fields->coefficients[N_TERMS * vertex + 2 + i] = a[i * (FREE + 1) + FREE];
    }
}

/* Fit fields with the wanted vertices' own places and slopes; coefficients (f, 14), the first two unchanged. */
KIRIKO_API void kiriko_fit_fields(const Fit *fit, double *coefficients, int64_t n_threads) {
    Fields fields = {.fit = fit, .coefficients = coefficients};
    share_out(fit_some_fields, &fields, fit->n_wanted, FITTED_AT_ONCE, n_threads);
}

/* Linear maps to the slopes of wanted vertices from the heights of their neighbours, (n, 2), and from their slopes,
   (p, 2, 2). */
typedef struct {
    const Fit *fit;
    double *from_heights, *from_slopes;
    const double *normal;    /* (f, 3) before and after a sweep */
    double *found, *changes; /* of each block of work */
} Sweeps;

static void make_some_slopes(void *context, int64_t first, int64_t last) {
    const Sweeps *s = context;
    const Fit *f = s->fit;
    for (int64_t n = first; n < last; n++) {
        int64_t vertex = f->wanted[n];
        double a[N_TERMS * (N_TERMS + 2)] = {0}, scale = 1;
        Neighbour neighbour;
        for (int64_t p = f->first[vertex]; p < f->first[vertex + 1]; p++) {
            read_neighbour(f, vertex, f->end[p], &neighbour);
            add_neighbour(&neighbour, 0, N_TERMS + 2, a, &scale);
        }
        add_ridge(f, 0, N_TERMS + 2, scale, a);
        for (int j = 0; j < 2; j++) a[j * (N_TERMS + 2) + N_TERMS + j] = 1;
        solve(a, N_TERMS, N_TERMS + 2);

        double *from_heights = s->from_heights + 2 * n;
        from_heights[0] = from_heights[1] = 0;
        for (int64_t p = f->first[vertex]; p < f->first[vertex + 1]; p++) {
            read_neighbour(f, vertex, f->end[p], &neighbour);
            double *from_slopes = s->from_slopes + 4 * p;
            for (int j = 0; j < 2; j++) {
                double from[3] = {0};
                for (int r = 0; r < 3; r++) {
                    for (int i = 0; i < N_TERMS; i++) from[r] += neighbour.terms[r][i] * a[i * (N_TERMS + 2) + N_TERMS + j];
                    from[r] *= neighbour.weights[r] * neighbour.weights[r];
                }
                from_heights[j] += from[0] * neighbour.z;
                from_slopes[j] = from[1];
                from_slopes[2 + j] = from[2];
            }
        }
    }
}

static void sweep_some(void *context, int64_t first, int64_t last) {
    const Sweeps *s = context;
    const Fit *f = s->fit;
    double change = 0;
    for (int64_t n = first; n < last; n++) {
        int64_t vertex = f->wanted[n];
        double slope[2] = {s->from_heights[2 * n], s->from_heights[2 * n + 1]}, theirs[2];
        for (int64_t p = f->first[vertex]; p < f->first[vertex + 1]; p++) {
            const double *from = s->from_slopes + 4 * p;
            find_slopes(f, vertex, s->normal + 3 * f->end[p], theirs);
            for (int j = 0; j < 2; j++) slope[j] += from[j] * theirs[0] + from[2 + j] * theirs[1];
        }
        double *found = s->found + 3 * vertex;
        for (int j = 0; j < 3; j++)
            found[j] = f->normal[3 * vertex + j] - slope[0] * f->axis_x[3 * vertex + j] - slope[1] * f->axis_y[3 * vertex + j];
        normalise(found);
        for (int j = 0; j < 3; j++) {
            double moved = fabs(found[j] - s->normal[3 * vertex + j]);
            if (moved > change) change = moved;
        }
    }
    s->changes[first / FITTED_AT_ONCE] = change;
}

/* The wanted vertices from the first on, n of them: a block of work. */
static Fit some_of(const Fit *fit, int64_t first, int64_t n) {
    Fit some = *fit;
    some.wanted += first;
    some.n_wanted = n;
    return some;
}

/* Find from_heights (n, 2) and from_slopes (p, 2, 2) of n wanted vertices from the first on. */
KIRIKO_API void kiriko_make_slopes(const Fit *fit, double *from_heights, double *from_slopes, int64_t first, int64_t n,
                                   int64_t n_threads) {
    Fit some = some_of(fit, first, n);
    Sweeps s = {.fit = &some, .from_heights = from_heights + 2 * first, .from_slopes = from_slopes};
    share_out(make_some_slopes, &s, n, FITTED_AT_ONCE, n_threads);
}

/* Make the normals (f, 3) of n wanted vertices, from the first on, agree with their neighbours' in `normal`.
   `changes` receives the largest change of each 256 vertices. The result does not depend on the number of threads. */
KIRIKO_API void kiriko_sweep_normals(const Fit *fit, const double *normal, double *found, double *from_heights,
                                     double *from_slopes, double *changes, int64_t first, int64_t n,
                                     int64_t n_threads) {
    Fit some = some_of(fit, first, n);
    Sweeps s = {.fit = &some, .from_heights = from_heights + 2 * first, .from_slopes = from_slopes, .normal = normal,
                .found = found, .changes = changes};
    share_out(sweep_some, &s, n, FITTED_AT_ONCE, n_threads);
}

static double height_of(const double *c, double u, double v) {
    double in_v = c[1] + u * (c[3] + u * (c[6] + u * c[10])) +
                  v * (c[4] + u * (c[7] + u * c[11]) + v * (c[8] + u * c[12] + v * c[13]));
    return u * (c[0] + u * (c[2] + u * (c[5] + u * c[9]))) + v * in_v;
}

typedef struct {
    const Fit *fit;
    const double *coefficients, *nodes, *weights;
    const int64_t *corner;
    double *offsets;
    int64_t n;
} Faces;

/* Add the field of a face's corner i to the offsets of its nodes, along these directions. */
static void add_offsets(const Faces *s, int64_t face, int i, const double directions[N_NODES][3],
                        double offsets[N_NODES][3]) {
    const Fit *f = s->fit;
    const int64_t *corner = s->corner + 3 * face;
    int64_t own = corner[i];
    const double *axes[3] = {f->axis_x + 3 * own, f->axis_y + 3 * own, f->normal + 3 * own};
    const double *c = s->coefficients + N_TERMS * own;
    double sides[2][3], leans[2][3], size = f->size[own];
    for (int k = 0; k < 2; k++) {
        int64_t end = corner[(i + k + 1) % 3];
        double away[3];
        for (int j = 0; j < 3; j++) away[j] = f->at[3 * end + j] - f->at[3 * own + j];
        for (int j = 0; j < 3; j++) {
            sides[k][j] = dot(away, axes[j]) / size;
            leans[k][j] = dot(f->normal + 3 * end, axes[j]);
        }
    }
    /* all nodes side by side, as each step depends on the one before */
    double place[3][N_NODES], lean[3][N_NODES], height[N_NODES] = {0};
    for (int node = 0; node < N_NODES; node++) {
        const double *part = s->nodes + 3 * node;
        double li = part[i], lj = part[(i + 1) % 3], lk = part[(i + 2) % 3];
        for (int j = 0; j < 3; j++) {
            place[j][node] = lj * sides[0][j] + lk * sides[1][j];
            lean[j][node] = lj * leans[0][j] + lk * leans[1][j];
        }
        lean[2][node] += li;
    }
    for (int node = 0; node < N_NODES; node++)
        height[node] = (height_of(c, place[0][node], place[1][node]) - place[2][node]) / lean[2][node];
    for (int turn = 0; turn < STEPS; turn++)
        for (int node = 0; node < N_NODES; node++) {
            double x = place[0][node] + height[node] * lean[0][node], y = place[1][node] + height[node] * lean[1][node];
            height[node] = (height_of(c, x, y) - place[2][node]) / lean[2][node];
        }
    for (int node = 0; node < N_NODES; node++) {
        double weight = s->weights[3 * node + i];
        if (!(weight > 0)) continue;
        for (int j = 0; j < 3; j++) offsets[node][j] += weight * (size * height[node]) * directions[node][j];
    }
}

static void find_some_offsets(void *context, int64_t first, int64_t last) {
    const Faces *s = context;
    for (int64_t face = first; face < last; face++) {
        double directions[N_NODES][3] = {0}, offsets[N_NODES][3] = {0};
        for (int node = 0; node < N_NODES; node++)
            for (int m = 0; m < 3; m++)
                for (int j = 0; j < 3; j++)
                    directions[node][j] += s->nodes[3 * node + m] * s->fit->normal[3 * s->corner[3 * face + m] + j];
        for (int i = 0; i < 3; i++) add_offsets(s, face, i, directions, offsets);
        for (int node = 0; node < N_NODES; node++)
            for (int j = 0; j < 3; j++) s->offsets[(3 * node + j) * s->n + face] = offsets[node][j];
    }
}

/* The offsets (12, 3, n) of the nodes of faces between vertices `corner` (n, 3). nodes (12, 3) and weights (12, 3)
   are defined in quartics.py and fitted_faces.py. */
KIRIKO_API void kiriko_find_offsets(const Fit *fit, const double *coefficients, const double *nodes,
                                    const double *weights, const int64_t *corner, int64_t n, double *offsets,
                                    int64_t n_threads) {
    Faces faces = {.fit = fit, .coefficients = coefficients, .nodes = nodes, .weights = weights, .corner = corner,
                   .n = n, .offsets = offsets};
    share_out(find_some_offsets, &faces, n, FITTED_AT_ONCE, n_threads);
}
