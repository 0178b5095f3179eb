/* Intersections of rays with curved faces, ray by ray. The numpy reference is core/glass/curved_hits.py. */

#include <string.h>

#include "kiriko.h"

#define ITERATIONS 12
#define PATIENCE 6
#define HOPELESS 0.05
#define CONVERGED 3e-6
#define ASIDE 0.6
#define WALKS 8
#define LINE 64 /* bytes of a cache line */
#define CORNER_TURNS 32 /* faces around a corner, in each direction */
#define FEW_STARTS 2

/* Coordinates of a point, and a number unused: their arithmetic goes side by side. */
typedef double Point __attribute__((vector_size(32)));

/* Whether a face is a paraboloid, without neighbours and followed beyond its edges. */
static bool is_paraboloid(const Curved *curved, int64_t k) { return curved->row[k] >= curved->n_quartics; }

/* Coefficients of a paraboloid by the normals at its corners, relative to its facet. */
static void load_paraboloid(const double *corner, const double *normal, Point *c) {
    const double *a = normal, *b = normal + 3, *e = normal + 6; /* at each corner */
    double high[3] = {0, 0, 0}; /* twice the sag of each edge: the height of a parabola */
    for (int j = 0; j < 3; j++) {
        high[0] += (b[j] - a[j]) * (corner[3 + j] - corner[j]);
        high[1] += (e[j] - a[j]) * (corner[6 + j] - corner[j]);
        high[2] += (e[j] - b[j]) * (corner[6 + j] - corner[3 + j]);
    }
    memset(c, 0, sizeof(Point) * N_TERMS);
    for (int j = 0; j < 3; j++) {
        double middle = (a[j] + b[j] + e[j]) / 6;
        c[2][j] = -(c[0][j] = high[0] * middle);
        c[4][j] = -(c[1][j] = high[1] * middle);
        c[3][j] = high[2] * middle - c[0][j] - c[1][j];
    }
}

static void load_terms(const double *from, Point *c) {
    for (int i = 0; i < N_TERMS; i++) c[i] = (Point){from[3 * i], from[3 * i + 1], from[3 * i + 2], 0};
}

/* Coefficients of points relative to the first corner. */
static void load_face(const Curved *curved, int64_t k, Point *c) {
    const double *corner = curved->corners + 9 * k;
    Point terms[N_TERMS];
    if (is_paraboloid(curved, k)) load_paraboloid(corner, curved->corner_normals + 9 * k, c);
    else load_terms(curved->coefficients + 3 * N_TERMS * curved->row[k], c);
    if (curved->lower && !is_paraboloid(curved, k)) {
        memcpy(terms, c, sizeof terms);
        for (int i = 0; i < N_TERMS; i++) {
            c[i] = (Point){0};
            for (int m = 0; m < N_TERMS; m++) c[i] += curved->lower[N_TERMS * i + m] * terms[m];
        }
    }
    for (int j = 0; j < 3; j++) {
        c[0][j] += corner[3 + j] - corner[j];
        c[1][j] += corner[6 + j] - corner[j];
    }
}

/* The value, and the derivatives by u and v. */
static inline void value_and_slopes(const Point *c, double u, double v, Point *at, Point *by_u, Point *by_v) {
    Point p3 = c[5] + u * c[9], p2 = c[2] + u * p3, p1 = c[0] + u * p2;
    Point r = u * c[10], s = u * c[11], r2 = c[6] + r, r1 = c[3] + u * r2, s1 = c[7] + s;
    Point a1 = c[1] + u * r1, a2 = c[4] + u * s1, a3 = c[8] + u * c[12];
    Point b1 = r1 + u * (r2 + r), b2 = s1 + s;
    Point q3 = a3 + v * c[13], q2 = a2 + v * q3, q1 = a1 + v * q2;
    *at = u * p1 + v * q1;
    *by_u = p1 + u * (p2 + u * (p3 + u * c[9])) + v * (b1 + v * (b2 + v * c[12]));
    *by_v = q1 + v * (q2 + v * (q3 + v * c[13]));
}

/* One step of Newton's method for u, v; returns the step's size before limiting. */
static double step(const Point *c, const Point *away, const double *d, double *u, double *v) {
    Point at, by_u, by_v;
    double across[3], normal[3];
    value_and_slopes(c, *u, *v, &at, &by_u, &by_v);
    at += *away;
    cross((double *)&at, d, across);
    cross((double *)&by_u, (double *)&by_v, normal);
    double inverse = 1.0 / dot(d, normal);
    double du = dot(across, (double *)&by_v) * inverse, dv = -dot(across, (double *)&by_u) * inverse;
    double size = fabs(du) > fabs(dv) ? fabs(du) : fabs(dv);
    if (du != du || dv != dv) size = NAN;
    double limit = size > 0.5 ? 0.5 / size : 1;
    *u = fmin(fmax(*u + limit * du, -1.0), 2.0);
    *v = fmin(fmax(*v + limit * dv, -1.0), 2.0);
    return size;
}

static bool goes_on(double u, double v, double size) {
    return !(size < CONVERGED) && u > -ASIDE && v > -ASIDE && 1.0 - u - v > -ASIDE;
}

/* Newton's method on the components of point(u, v) - origin across the ray; steps and range are limited. */
static bool newton(const Point *c, const Point *away, const double *d, Hit *hit) {
    Point at, by_u, by_v;
    double size = 0;
    for (int turn = 0; turn < ITERATIONS; turn++) {
        size = step(c, away, d, &hit->u, &hit->v);
        if (turn < 1) continue;
        if (!goes_on(hit->u, hit->v, size) || (turn >= PATIENCE && !(size < HOPELESS))) break;
    }
    value_and_slopes(c, hit->u, hit->v, &at, &by_u, &by_v);
    at += *away;
    hit->distance = dot(d, (double *)&at);
    cross((double *)&by_u, (double *)&by_v, hit->facing);
    hit->enters = dot(d, hit->facing) < 0;
    return size < CONVERGED;
}

/* The place on a neighbour across the edge where u, v left the face. */
static void step_over(const Curved *curved, int64_t row, int edge, double *u, double *v) {
    double along = edge == 0 ? *u : edge == 1 ? *v : 1 - *u - *v; /* weight of the corner at the edge's end */
    along = along < 0 ? 0 : along > 1 ? 1 : along;
    double weights[3] = {0, 0, 0};
    int theirs = (int)curved->neighbour_edge[3 * row + edge];
    weights[theirs] = along; /* the neighbour runs in the opposite direction */
    weights[(theirs + 1) % 3] = 1 - along;
    *u = weights[1];
    *v = weights[2];
}

/* A root on a face or, after some walks, on another; of either side. */
static bool find_root(const Curved *curved, int64_t triangle, double u, double v, const double *o, const double *d,
                      int walks, Hit *hit) {
    Point c[N_TERMS], away = {0};
    hit->triangle = triangle;
    hit->is_curved = true;
    hit->u = u;
    hit->v = v;
    for (int walk = 0; walk < walks; walk++) {
        int64_t k = hit->triangle, row = curved->row[k];
        load_face(curved, k, c);
        for (int j = 0; j < 3; j++) away[j] = curved->corners[9 * k + j] - o[j];
        bool done = newton(c, &away, d, hit);
        double outside[3] = {hit->v, 1 - hit->u - hit->v, hit->u}; /* distances from the edges */
        int edge = 0;
        for (int e = 1; e < 3; e++)
            if (outside[e] < outside[edge]) edge = e;
        if (outside[edge] >= -(is_paraboloid(curved, k) ? WIDE : EDGE)) return done;
        if (!done && outside[edge] > -ASIDE) return false;
        int64_t next = curved->neighbour[3 * row + edge];
        if (next < 0) return false;
        hit->triangle = next;
        step_over(curved, row, edge, &hit->u, &hit->v);
    }
    return false;
}

/* Two unit vectors perpendicular to a direction and to each other, as quartics.tangents. */
void tangents(const double *d, double axes[2][3]) {
    double sign = copysign(1.0, d[2]), a = -1.0 / (sign + d[2]), b = d[0] * d[1] * a;
    axes[0][0] = 1.0 + sign * d[0] * d[0] * a;
    axes[0][1] = sign * b;
    axes[0][2] = -sign * d[0];
    axes[1][0] = b;
    axes[1][1] = sign + d[1] * d[1] * a;
    axes[1][2] = -d[1];
}

/* Whether the box around a face's Bezier points, seen along a ray by its tangents, contains the ray. */
bool is_in_box(const Curved *curved, int64_t k, const double *o, const double axes[2][3]) {
    Point c[N_TERMS];
    if (is_paraboloid(curved, k)) return true;
    load_face(curved, k, c);
    for (int a = 0; a < 2; a++) {
        const double *axis = axes[a];
        double seen[N_TERMS], low = 0, high = 0, at = 0; /* the first corner is the origin */
        for (int i = 0; i < N_TERMS; i++) seen[i] = dot((const double *)&c[i], axis);
        for (int j = 0; j < 3; j++) at += (o[j] - curved->corners[9 * k + j]) * axis[j];
        for (int n = 1; n <= N_TERMS; n++) {
            const double *row = curved->to_bezier + N_TERMS * n;
            double point = 0;
            for (int i = 0; i < N_TERMS; i++) point += row[i] * seen[i];
            low = point < low ? point : low;
            high = point > high ? point : high;
        }
        double slack = 2 * EDGE * (high - low);
        if (!(low - slack <= at && at <= high + slack)) return false;
    }
    return true;
}

static double facing_along(const Point *c, const double *d, double u, double v, Point *by_u, Point *by_v) {
    Point at;
    double normal[3];
    value_and_slopes(c, u, v, &at, by_u, by_v);
    cross((double *)by_u, (double *)by_v, normal);
    return dot(d, normal);
}

static double or_zero(double x) { return x == x ? x : 0; }

/* Reflect u, v to the opposite side of the curve where the ray is tangent to the surface. */
static void across(const Curved *curved, int64_t k, const double *d, double *u, double *v) {
    Point c[N_TERMS], by_u_here, by_v_here, other_u, other_v;
    load_face(curved, k, c);
    double here = facing_along(c, d, *u, *v, &by_u_here, &by_v_here);
    const double *by_u = (double *)&by_u_here, *by_v = (double *)&by_v_here;
    double uu = dot(by_u, by_u), uv = dot(by_u, by_v), vv = dot(by_v, by_v), du = dot(d, by_u), dv = dot(d, by_v);
    double a = (vv * du - uv * dv) / (uu * vv - uv * uv), b = (uu * dv - uv * du) / (uu * vv - uv * uv);
    double size = fabs(a) > fabs(b) ? fabs(a) : fabs(b), far = 1e-3;
    a /= size;
    b /= size;
    double way = -2 * here * far / (facing_along(c, d, *u + far * a, *v + far * b, &other_u, &other_v) - here);
    way = or_zero(way);
    way = way < -1 ? -1 : way > 1 ? 1 : way;
    *u += way * or_zero(a);
    *v += way * or_zero(b);
}

/* Search for a ray's nearest root on the required side, between two distances. */
typedef struct {
    const Curved *curved;
    const double *o, *d;
    double axes[2][3]; /* of the ray */
    int n_starts;
    bool leaves, is_found;
    double least, most;
    Hit *hit;
} Around;

static void search_face(Around *around, int64_t k) {
    if (!is_in_box(around->curved, k, around->o, around->axes)) return;
    for (int s = 0; s < around->n_starts; s++) {
        Hit other;
        if (!find_root(around->curved, k, STARTS[s][0], STARTS[s][1], around->o, around->d, WALKS, &other)) continue;
        double t = other.distance;
        if (other.enters == around->leaves || !(t > around->least && t < around->most)) continue;
        *around->hit = other;
        around->most = t;
        around->is_found = true;
    }
}

/* Search a face and the faces around its corners, from many places on each. */
static bool search_around(Around *around, int64_t triangle) {
    const Curved *curved = around->curved;
    tangents(around->d, around->axes);
    search_face(around, triangle);
    for (int corner = 0; corner < 3; corner++) {
        bool is_closed = false;
        for (int way = 0; way < 2 && !is_closed; way++) {
            int64_t k = triangle;
            int at = corner; /* index of the corner in the face */
            for (int turn = 0; turn < CORNER_TURNS; turn++) {
                int64_t place = 3 * curved->row[k] + (way ? (at + 2) % 3 : at);
                k = curved->neighbour[place];
                is_closed = k == triangle;
                if (k < 0 || is_closed) break;
                at = ((int)curved->neighbour_edge[place] + !way) % 3;
                search_face(around, k);
            }
        }
    }
    return around->is_found;
}

static void fetch(const void *from, size_t size) {
    for (size_t k = 0; k < size; k += LINE) __builtin_prefetch((const char *)from + k);
}

/* Prefetch a face before its intersection. */
void fetch_face(const Curved *curved, int64_t k) {
    fetch(curved->corners + 9 * k, sizeof(double) * 9);
    if (curved->row[k] >= 0) fetch(curved->coefficients + 3 * N_TERMS * curved->row[k], sizeof(double) * 3 * N_TERMS);
}

/* Prefetch the refracting normals of a face while the root is computed. */
static void fetch_normals(const Curved *curved, int64_t triangle) {
    if (!curved->normal_terms) return;
    int64_t row = curved->row[triangle], terms = curved->normal_row[row];
    if (terms < 0) return;
    fetch(curved->normal_terms + 3 * N_TERMS * terms, sizeof(double) * 3 * N_TERMS);
    for (int i = 0; i < 3; i++) __builtin_prefetch(curved->vertex_normal + 3 * curved->vertex[3 * row + i]);
}

/* The normal by which a face refracts. */
static void bend(const Curved *curved, Hit *hit) {
    copy(hit->facing, hit->normal);
    if (!curved->normal_terms) return;
    int64_t row = curved->row[hit->triangle], terms = curved->normal_row[row];
    if (terms < 0) return;
    const double *corner[3];
    Point c[N_TERMS], at, by_u, by_v;
    load_terms(curved->normal_terms + 3 * N_TERMS * terms, c);
    for (int i = 0; i < 3; i++) corner[i] = curved->vertex_normal + 3 * curved->vertex[3 * row + i];
    for (int j = 0; j < 3; j++) {
        c[0][j] += corner[1][j] - corner[0][j];
        c[1][j] += corner[2][j] - corner[0][j];
    }
    value_and_slopes(c, hit->u, hit->v, &at, &by_u, &by_v);
    for (int j = 0; j < 3; j++) hit->normal[j] = corner[0][j] + at[j];
}

static bool is_odd(const Hit *hit, bool leaves, double least) {
    return hit->enters == leaves && (leaves || hit->distance > least);
}

/* Intersection of a ray with the curved surface, starting from u, v of a triangle; false for none.

   leaves : whether the ray comes from inside, so only back faces can be hit; NULL: either side
   least : a closer root belongs to a ray that has just left the surface
   is_last : all faces near the ray are tested anyway, so neighbours need no search */
bool hit_curved(const Curved *curved, int64_t triangle, double u, double v, const double *o, const double *d,
                 const bool *leaves, double least, bool is_last, Hit *hit) {
    int walks = is_last ? 2 : WALKS;
    fetch_normals(curved, triangle);
    Around around = {.curved = curved, .o = o, .d = d, .leaves = leaves && *leaves, .hit = hit};
    if (!find_root(curved, triangle, u, v, o, d, walks, hit)) {
        /* a grazing ray may still hit the surface */
        around.n_starts = FEW_STARTS;
        around.least = least;
        around.most = INFINITY;
        if (is_last || !leaves || !search_around(&around, triangle)) return false;
    } else if (leaves && is_odd(hit, *leaves, least)) {
        Hit other;
        double x = hit->u, y = hit->v;
        across(curved, hit->triangle, d, &x, &y);
        if (find_root(curved, hit->triangle, x, y, o, d, walks, &other) && other.enters != *leaves) *hit = other;
        /* an entering ray hits the front before the back found; inside, the back is beyond */
        around.n_starts = N_STARTS;
        around.least = *leaves ? hit->distance : -INFINITY;
        around.most = *leaves ? INFINITY : hit->distance;
        if (!is_last && is_odd(hit, *leaves, least) && hit->distance > least) search_around(&around, hit->triangle);
    }
    bend(curved, hit);
    return true;
}
