/* Curved faces from offsets of their nodes, and agreement of normals between neighbours, face by face. The numpy
   reference is core/glass/fitted_faces.py and core/glass/agreement.py. */

#include "kiriko.h"

#define N_NODES 12
#define N_ON_EDGES 9   /* nodes, three on each edge */
#define N_AT 15        /* nodes and corners */
#define SIDE_BY_SIDE 8 /* faces */
#define FITTED_AT_ONCE 256 /* faces, as in fitting.py */

/* Offsets of faces' nodes, the mesh below them, and the resulting faces. */
typedef struct {
    const double *offsets;                    /* (12, 3, n) */
    const double *corners, *normals, *facets; /* (n, 3, 3), (n, 3, 3) at the corners, (n, 3) */
    const double *by_u, *by_v, *to_terms;     /* (15, 12), (15, 12), (14, 12) */
    double most_offset, least_cosine, swollen, untold;
    double *coefficients, *own;               /* (n, 14, 3), (n, 15, 3) */
    uint8_t *is_whole, *is_swollen;
    int64_t n;
} MadeFaces;

static void away_from(const double *a, const double *b, double *out) {
    for (int j = 0; j < 3; j++) out[j] = b[j] - a[j];
}

static double length(const double *a) { return sqrt(dot(a, a)); }

/* Multiply a matrix (rows, 12) by the offsets of some faces. */
static void combine(const double *matrix, int rows, const double offsets[N_NODES][3][SIDE_BY_SIDE],
                    double found[][3][SIDE_BY_SIDE]) {
    for (int r = 0; r < rows; r++)
        for (int j = 0; j < 3; j++) {
            double sum[SIDE_BY_SIDE] = {0};
            for (int k = 0; k < N_NODES; k++) {
                double weight = matrix[N_NODES * r + k];
                for (int i = 0; i < SIDE_BY_SIDE; i++) sum[i] += weight * offsets[k][j][i];
            }
            for (int i = 0; i < SIDE_BY_SIDE; i++) found[r][j][i] = sum[i];
        }
}

/* Whether a face with normals `own` stays near its facet, with a similar direction. */
static bool is_whole(const MadeFaces *s, int64_t face, const double offsets[N_NODES][3]) {
    const double *corners = s->corners + 9 * face, *own = s->own + 3 * N_AT * face;
    double side[3], longest;
    away_from(corners, corners + 3, side);
    longest = length(side);
    away_from(corners, corners + 6, side);
    if (length(side) > longest) longest = length(side);
    for (int k = 0; k < N_NODES; k++)
        if (!(length(offsets[k]) < s->most_offset * longest)) return false;
    for (int k = 0; k < N_AT; k++)
        if (!(dot(own + 3 * k, s->facets + 3 * face) > s->least_cosine)) return false;
    return true;
}

/* Whether a face bulges in or out further than the normals at its corners explain. */
static bool is_swollen(const MadeFaces *s, int64_t face, const double offsets[N_NODES][3]) {
    const double *corners = s->corners + 9 * face, *normals = s->normals + 9 * face;
    double most_sag = 0, least_sag = 0, longest = 0, middle[3];
    for (int e = 0; e < 3; e++) {
        int end = (e + 1) % 3;
        double along[3], turned[3];
        away_from(corners + 3 * e, corners + 3 * end, along);
        away_from(normals + 3 * e, normals + 3 * end, turned);
        double sag = dot(turned, along) / 8;
        if (sag > most_sag) most_sag = sag;
        if (sag < least_sag) least_sag = sag;
        if (length(along) > longest) longest = length(along);
    }
    for (int j = 0; j < 3; j++) middle[j] = normals[j] + normals[3 + j] + normals[6 + j];
    normalise(middle);
    double highest = -INFINITY, lowest = INFINITY, more = s->untold * longest;
    for (int k = 0; k < N_NODES; k++) {
        double height = dot(offsets[k], middle);
        if (isnan(height)) return false;
        if (height > highest) highest = height;
        if (height < lowest) lowest = height;
    }
    return highest > s->swollen * most_sag + more || lowest < s->swollen * least_sag - more;
}

/* Make n faces, SIDE_BY_SIDE at most, starting at `first`. */
static void make_few(const MadeFaces *s, int64_t first, int n) {
    double offsets[N_NODES][3][SIDE_BY_SIDE] = {0}, terms[N_TERMS][3][SIDE_BY_SIDE];
    double by_u[N_AT][3][SIDE_BY_SIDE], by_v[N_AT][3][SIDE_BY_SIDE];
    for (int k = 0; k < N_NODES; k++)
        for (int j = 0; j < 3; j++)
            for (int i = 0; i < n; i++) offsets[k][j][i] = s->offsets[(3 * k + j) * s->n + first + i];
    combine(s->to_terms, N_TERMS, offsets, terms);
    combine(s->by_u, N_AT, offsets, by_u);
    combine(s->by_v, N_AT, offsets, by_v);

    for (int i = 0; i < n; i++) {
        int64_t face = first + i;
        double side_u[3], side_v[3], mine[N_NODES][3];
        away_from(s->corners + 9 * face, s->corners + 9 * face + 3, side_u);
        away_from(s->corners + 9 * face, s->corners + 9 * face + 6, side_v);
        for (int k = 0; k < N_AT; k++) {
            double u[3], v[3], *normal = s->own + 3 * (N_AT * face + k);
            for (int j = 0; j < 3; j++) {
                u[j] = by_u[k][j][i] + side_u[j];
                v[j] = by_v[k][j][i] + side_v[j];
            }
            cross(u, v, normal);
            double size = length(normal);
            for (int j = 0; j < 3; j++) normal[j] /= size;
        }
        for (int k = 0; k < N_NODES; k++)
            for (int j = 0; j < 3; j++) mine[k][j] = offsets[k][j][i];
        for (int k = 0; k < N_TERMS; k++)
            for (int j = 0; j < 3; j++) s->coefficients[3 * (N_TERMS * face + k) + j] = terms[k][j][i];
        s->is_whole[face] = is_whole(s, face, mine);
        s->is_swollen[face] = is_swollen(s, face, mine);
    }
}

static void make_some(void *context, int64_t first, int64_t last) {
    for (; first < last; first += SIDE_BY_SIDE)
        make_few(context, first, last - first < SIDE_BY_SIDE ? (int)(last - first) : SIDE_BY_SIDE);
}

/* Make n faces: coefficients and normals, and whether each stays near its facet, and is swollen. */
KIRIKO_API void kiriko_make_faces(const double *offsets, const double *corners, const double *normals,
                                  const double *facets, const double *matrices, const double *knobs, int64_t n,
                                  double *coefficients, double *own, uint8_t *whole, uint8_t *are_swollen,
                                  int64_t n_threads) {
    MadeFaces faces = {.offsets = offsets, .corners = corners, .normals = normals, .facets = facets, .n = n,
                       .by_u = matrices, .by_v = matrices + N_AT * N_NODES, .to_terms = matrices + 2 * N_AT * N_NODES,
                       .most_offset = knobs[0], .least_cosine = knobs[1], .swollen = knobs[2], .untold = knobs[3],
                       .coefficients = coefficients, .own = own, .is_whole = whole, .is_swollen = are_swollen};
    share_out(make_some, &faces, n, FITTED_AT_ONCE, n_threads);
}

/* Faces whose normals must agree with their neighbours', and the result. */
typedef struct {
    const double *own, *at_corners, *area;     /* (p, 15, 3), (p, 3, 3), (p,) */
    const int32_t *row, *triangle;             /* (t,) face; (p, 3) triangle across each edge, or -1 */
    const int8_t *edge;                        /* (p, 3) edge of the neighbour */
    const uint8_t *is_drawn;                   /* (p, 3) */
    const double *nodes, *inward;              /* (9, 3), (3, 15) */
    double least;                              /* smallest change applied inside */
    double *normals, *jump;                    /* (p, 12, 3), (p, 9) */
    int64_t from;                              /* number of the first face */
} Agreeing;

/* The normals on an edge of a face, and their deviations. */
static void agree_on_edge(const Agreeing *s, int64_t face, int e, double *agreed, double *jump) {
    const double *own = s->own + 3 * N_AT * face;
    int32_t triangle = s->triangle[3 * face + e];
    const double *theirs = NULL;
    double my_part = 1, their_part = 0;
    if (triangle >= 0) {
        int64_t other = s->row[triangle];
        double mine = s->area[face] * s->area[face], others = s->area[other] * s->area[other];
        my_part = mine / (mine + others);
        their_part = others / (mine + others);
        theirs = s->own + 3 * (N_AT * other + 3 * s->edge[3 * face + e]);
    }
    for (int k = 0; k < 3; k++) {
        int node = 3 * e + k;
        const double *mine = own + 3 * node;
        double *found = agreed + 3 * node;
        jump[node] = 0;
        if (theirs) { /* the neighbour runs in the opposite direction */
            const double *there = theirs + 3 * (2 - k);
            double away[3];
            away_from(there, mine, away);
            for (int j = 0; j < 3; j++) found[j] = my_part * mine[j] + their_part * there[j];
            normalise(found);
            jump[node] = length(away) * 2 * sqrt(my_part * their_part);
        } else if (s->is_drawn[3 * face + e]) {
            const double *part = s->nodes + 3 * node, *corner = s->at_corners + 9 * face;
            for (int j = 0; j < 3; j++) found[j] = part[0] * corner[j] + part[1] * corner[3 + j] + part[2] * corner[6 + j];
        } else {
            copy(mine, found);
        }
    }
}

static void agree_some(void *context, int64_t first, int64_t last) {
    const Agreeing *s = context;
    for (int64_t face = s->from + first; face < s->from + last; face++) {
        const double *own = s->own + 3 * N_AT * face, *at_corners = s->at_corners + 9 * face;
        double *agreed = s->normals + 3 * N_NODES * face, change[N_AT][3] = {0}, most = 0;
        for (int e = 0; e < 3; e++) agree_on_edge(s, face, e, agreed, s->jump + N_ON_EDGES * face);
        for (int k = 0; k < N_AT; k++) {
            bool is_inside = k >= N_ON_EDGES && k < N_NODES;
            if (is_inside) continue;
            away_from(own + 3 * k, k < N_NODES ? agreed + 3 * k : at_corners + 3 * (k - N_NODES), change[k]);
            for (int j = 0; j < 3; j++)
                if (fabs(change[k][j]) > most) most = fabs(change[k][j]);
        }
        for (int k = N_ON_EDGES; k < N_NODES; k++) {
            copy(own + 3 * k, agreed + 3 * k);
            if (!(most > s->least)) continue;
            const double *weights = s->inward + N_AT * (k - N_ON_EDGES);
            for (int m = 0; m < N_AT; m++)
                for (int j = 0; j < 3; j++) agreed[3 * k + j] += weights[m] * change[m][j];
        }
    }
}

/* Make the normals of n faces, starting at `first`, agree with their neighbours. */
KIRIKO_API void kiriko_agree(const double *own, const double *at_corners, const double *area, const int32_t *row,
                             const int32_t *triangle, const int8_t *edge, const uint8_t *is_drawn, const double *nodes,
                             const double *inward, double least, int64_t from, int64_t n, double *normals, double *jump,
                             int64_t n_threads) {
    Agreeing faces = {.own = own, .at_corners = at_corners, .area = area, .row = row, .triangle = triangle,
                      .edge = edge, .is_drawn = is_drawn, .nodes = nodes, .inward = inward, .least = least,
                      .normals = normals, .jump = jump, .from = from};
    share_out(agree_some, &faces, n, FITTED_AT_ONCE, n_threads);
}
