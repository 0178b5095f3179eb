/* Structures shared with Python, and small functions shared by all files.

   Every structure is mirrored in structures.py, field by field, and its size is checked when the library is loaded.
   Lengths are in m and directions are unit vectors. Names are documented in core/light/plan.py,
   core/light/ray_engine.py and core/glass/curved.py; constants repeat options of core/light/layer_hits.py and
   others. */

#ifndef KIRIKO_H
#define KIRIKO_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#if defined(_WIN32)
#define KIRIKO_API __declspec(dllexport)
#else
#define KIRIKO_API __attribute__((visibility("default")))
#endif

#define VERSION 16 /* raised when a structure's meaning changes, even at the same size */
#define N_TERMS 14
#define MOST_LAYERS 256
#define N_BITS 52           /* of a ray's mask, as in media.py */
#define MOST_BUNDLED 32     /* rays */
#define MOST_UNITS 4096     /* in near_misses.py */
#define N_LEVELS 5          /* of boxes in near_misses.py */
#define EDGE 1e-10          /* barycentric slack, as in curved.py */
#define WIDE 0.5            /* the same for paraboloids, as in paraboloids.py */
#define WIDER 1e-6          /* slack for a ray without a hit, as in layer_hits.py */
#define FLOAT32 0x1p-23     /* spacing of float32 numbers just above 1 */

/* u, v from which a face is searched for a root, as in curved_hits.py */
#define N_STARTS 4
static const double STARTS[N_STARTS][2] = {{1.0 / 3, 1.0 / 3}, {0.1, 0.1}, {0.8, 0.1}, {0.1, 0.8}};

typedef enum { GLASS, PLATE, MIRROR, BLOCKER, DISPLAY, HALF_MIRROR, RETROREFLECTOR, LENS } Kind;

typedef enum { ARRIVED, MISSED_GLASS, LOST_INSIDE, MISSED_PLATE, BLOCKED, MISSED_DISPLAY, CUT_OFF } Reason;

typedef enum { PASS = 1, TIR, AT_PLATE, AT_MIRROR, LAND, FACE_PASS, FACE_TIR, AT_MIRROR_FACE } Event; /* as in rays.py */

typedef enum { NONE, IMAGED, STRAY_1, STRAY_2, THROUGH, REFLECTED } PlatePath;

typedef enum { IMAGED_LIGHT, FOLDED_LIGHT, REFLECTED_LIGHT } Light;

/* Four boxes of a tree: low and high sides along x, y and z. Each holds a node, or the complement of a block. The low
   sides of none are infinite. */
typedef struct {
    float sides[6][4];
    int32_t children[4], unused[4]; /* a node fills two cache lines */
} Node;

typedef struct {
    const Node *nodes;
    const int32_t *items;   /* of each block, four; the last one is repeated */
} Tree;

/* The construction of a tree over n boxes of about unit size. */
typedef struct {
    const double *boxes;    /* (n, 2, 3) */
    int64_t n;
    Node *nodes;            /* capacity n */
    int32_t *items;         /* capacity (n, 4) */
    int64_t n_nodes;        /* 0 until complete, and if memory is short */
    int64_t n_blocks;
    _Atomic int64_t is_cancelled; /* set to cancel */
} TreeTask;

typedef struct {
    double *corners;        /* (t, 3, 3) */
    int64_t *row;           /* (t,) */
    double *coefficients;   /* (p, 14, 3) */
    int64_t *neighbour;     /* (p, 3) */
    int64_t *neighbour_edge;
    int64_t *vertex;        /* (p, 3) */
    double *vertex_normal;  /* (f, 3) */
    int64_t *normal_row;    /* (p,) */
    double *normal_terms;   /* (q, 14, 3), NULL if each face refracts by its own normals */
    double *lower;          /* (14, 14), NULL for degree 4 */
    double *to_bezier;      /* (15, 14) */
    int64_t n_quartics;     /* rows: those after are paraboloids */
    double *corner_normals; /* (t, 3, 3) of paraboloids */
} Curved;

/* The triangles around curved faces: EngineTriangles of ray_engine.py. */
typedef struct {
    float *corners;         /* (b, 9, 4) by block, from the layer's centre, in units of its radius */
    int64_t *owner;         /* (b, 4) by position */
    float *places;          /* (p - n_whole, 3, 2) u, v of the shell triangles' corners in their face */
    int64_t n_whole;
    Tree tree;
} EngineTriangles;

typedef struct {
    int64_t n_triangles;
    double *frames;         /* (t, 4, 3): corner, normal, axis_u, axis_v */
    int64_t *numbers;       /* (t,) in the plan */
    int64_t only_part;      /* part of all its triangles, -1 if several: saves a table access */
    uint64_t *closed_bits;  /* (clusters,) */
    uint64_t *solid_bits;   /* (clusters,), NULL with thin surfaces */
    Curved *curved;         /* NULL if all is flat; so is the next */
    EngineTriangles *engine_triangles;
    double *rotation;       /* (3, 3), NULL without a motion */
    double shift[3];
    double low[3], high[3], centre[3], radius, tolerance;
    int64_t has_engine, n_starts;
    Tree over_faces;        /* of a curved layer: without nodes until a ray needs it */
    double *facets;         /* frames by position in this tree, for locality */
} Layer;

/* A mirror array in place: MirrorArray of mirror_array.py and ArrayFrame of plate.py. */
typedef struct {
    double centre[3], axes[9];
    double pitch, height, thickness, ior, reflectance, crossing_error, phase[2];
    int64_t layout, has_fresnel;
} Array;

/* How light splits: shares of a half mirror, and the path preferred if both arrive. */
typedef enum { BRIGHTER, REFLECTED_FIRST, TRANSMITTED_FIRST } Preference;

typedef struct {
    double reflectance, transmittance;
    int64_t prefers;
} Split;

typedef struct {
    double *normals, *corner_normals;  /* (t, 3), (t, 3, 3) or NULL */
    uint8_t *is_bent;                  /* (t,) */
    int64_t *patch, *part;             /* (t,) */
    int64_t *kind, *cluster, *sheet;   /* (p,) */
    uint8_t *is_closed, *is_clear;     /* (p,), (p, 2) */
    uint64_t *bit;                     /* (p,) */
    const void **elements;             /* (p,) data of its interaction: an Array for a plate of mirrors, a Split for a half
                                          mirror and for glass that reflects, four doubles for a lens; else NULL */
    double *indices;                   /* (solids, N_BITS + 1) */
    double *absorptions;               /* the same, 1/m; NULL if nothing absorbs */
    int64_t n_triangles, n_open, n_deferred, n_layers;
    int64_t *open_part;                /* (n_open,) */
    double *open_box, *deferred_box;      /* (n, 2, 3) */
    Layer *layers;
    int64_t *order;                    /* (n_layers,) order of searching */
    double merge_distance;
    int64_t max_events, has_glass, only_through_glass, needs_plate, looks_beside, brightness;
    int64_t has_plane, is_by_glass, display_start;
    double plane_corner[3], plane_normal[3], plane_pixels[6], plane_origin[2];
    double *display_uv;                /* (., 3, 2) */
    double display_size[2];
} Plan;

/* State of rays, as Rays in rays.py, and their recorded paths. */
typedef struct {
    double *positions, *directions;    /* (n, 3) */
    uint64_t *mask;
    int64_t *cluster;
    uint8_t *reason;
    uint64_t *branch;
    double *xy, *throughput;           /* (n, 2), (n,) */
    double *absorption;                /* (n,) 1/m, of the medium around the ray */
    int64_t *n_events, *rank, *n_splits;
    uint8_t *has_met_glass, *has_met_plate, *plate_path;
    int64_t *last_part, *leak;
    uint64_t *course;                  /* (n, width), or NULL */
    int64_t width, is_recorded, light;
    int64_t *n_words;
    uint8_t *is_astray, *has_ended, *is_begun;
    int64_t n_asked, n_copies;         /* rows: first the traced rays, then the copies of rays that split */
    int64_t n_rays, n_steps;           /* rows; 0 if no path is recorded */
    double *places;                    /* (n_steps, n, 3): most paths only touch the first steps */
    int64_t *met;                      /* (n_steps, n) triangle numbers + 1; 0 for none */
    int64_t *left_at;                  /* (n,) event at which the ray left without a hit, -1 if it ended otherwise */
    uint8_t *is_reached;               /* (n_deferred,) */
    uint8_t *is_unready;               /* set if a ray needed a tree of faces not yet made */
} Rays;

/* Hit of a ray on a triangle of a layer; distance is INFINITY and triangle -1 for none. */
typedef struct {
    double distance, u, v;
    int64_t triangle, part;            /* the part is only set for true hits */
    bool enters, is_curved;
    double facing[3], normal[3];       /* of curved faces, not unit */
} Hit;

/* Edges to be bisected for the last place on a branch, as in core/map/borders.py, and the viewer, as in viewer.py. */
typedef struct {
    const double *start, *way;         /* (n, 2) viewer px: near ends, and vectors to the far ends */
    const uint64_t *branch;            /* (n,) */
    double *low, *width;               /* (n,) fractions: the last place found, and the uncertainty beyond it */
    double *xy, *throughput;           /* (n, 2), (n,) at this place */
    int64_t *n_tried;                  /* (n,) rays */
    double least;                      /* width at which bisection stops */
    double position[3], axes[9], window[4], size[2];
    int64_t is_orthographic;
} Halving;

/* Cells to be divided among the pixels of a display, the state of the division, and a buffer of shares, as in
   rasterise.py. */
typedef struct {
    const double *view, *display;      /* (n_cells, n_corners, 2) viewer px and display px */
    int64_t n_cells, n_corners, width, height;
    int64_t cell, part, row, column;   /* where to continue: part of a folded quad, row and column of its window */
    int64_t n, room;                   /* number of shares, and capacity */
    int32_t *pixel;                    /* (room,), NULL if wide_pixel is used */
    int64_t *wide_pixel;
    double *view_xy;                   /* (room, 2) */
    float *covariance;                 /* (3, room) */
    double *area, *display_area;
    int64_t *number;                   /* of the cell, or NULL */
} Division;

/* Weights added to the pixels of an image: by pixel number, narrow or wide, or by place. */
typedef struct {
    const int32_t *pixel;              /* (n,), NULL if wide_pixel is used */
    const int64_t *wide_pixel;
    const double *places;              /* (n, 2) px, NULL if there are numbers */
    const double *weights;             /* (n,) */
    int64_t n;
    double *image;                     /* (height, width) */
    int64_t width, height;
} Sum;

/* Shares painted from a flat picture, as in source_image.py, and the mapping to it, as in flat_picture.py. */
typedef struct {
    const int32_t *pixel;              /* (n,) of the display, NULL if wide_pixel is used */
    const int64_t *wide_pixel;
    const double *view_xy;             /* (n, 2) */
    const float *covariance;           /* (3, n), with row stride `apart` */
    int64_t apart;
    const double *area, *throughput;   /* (n,), throughput may be NULL */
    int64_t n;
    double matrix[9];                  /* from viewer px to the picture's UV */
    double low[2], high[2], size[2];   /* bounds of the picture in UV; its pixels */
} FlatTaps;

/* One size of a picture. */
typedef struct {
    const float *pixels;               /* (height, width, 4) */
    int64_t width, height, stride;     /* between rows, in numbers; negative if the lowest row comes first */
} Level;

/* Four neighbouring pixels of a level added to a display pixel, at upper left, upper right, lower left and lower
   right; row and column are the first's. */
typedef struct {
    int32_t pixel, level, row, column;
    float weight[4];
} Tap;

#define N_STRIPES 16 /* interleaved, of display pixels; a thread reads all shares and paints its stripes */

/* Taps of each stripe in the order of its shares, for the next picture; `room` is negative where memory ran out. */
typedef struct {
    Tap *taps[N_STRIPES];
    int64_t n[N_STRIPES], room[N_STRIPES];
} KeptTaps;

/* Vertices with the surface as a height field, and the ones to compute, as in vertices.py. */
typedef struct {
    const double *at, *normal;         /* (f, 3) */
    const double *axis_x, *axis_y;     /* (f, 3) */
    const double *size;                /* (f,) */
    const uint8_t *is_known, *is_rim;  /* (f,) */
    const int64_t *first, *end;        /* (f + 1,), (p,) */
    const int64_t *wanted;             /* (n_wanted,) */
    int64_t n_wanted;
    double ridge[N_TERMS];
} Fit;

/* Triangles in boxes of several levels, the last with one each, as in near_misses.py. */
typedef struct {
    const double *boxes[N_LEVELS];     /* (n, 2, 3) of each level */
    const int64_t *children[N_LEVELS]; /* (n + 1,) the first box of the next level in each */
    const double *frames;              /* (t, 4, 3): corner, normal, axis_u, axis_v */
    const int64_t *unit_of_patch;      /* (n_patches,) */
    int64_t n_patches, n_units;        /* units are the boxes of the first level */
} ThinParts;

/* Paths of rays, grouped into n bundles. */
typedef struct {
    const double *places;              /* (r, n_events + 1, 3) */
    const int32_t *met;                /* (r, n_events) patches */
    const int64_t *rays;               /* (n, n_rays) of each bundle: rows of both */
    int64_t n, n_rays, n_events;
    double widest;
    uint8_t *touched;                  /* (n,) */
} Paths;

static inline double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline void cross(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static inline void copy(const double *from, double *to) {
    for (int i = 0; i < 3; i++) to[i] = from[i];
}

/* Scale to length 1; zero stays zero. */
static inline void normalise(double *a) {
    double length = sqrt(dot(a, a));
    if (!(length > 0)) return;
    for (int i = 0; i < 3; i++) a[i] /= length;
}

/* The cosine, 0..1, of the angle between a ray and a normal, which need not be unit. */
static inline double cosine_of(const double *d, const double *normal) {
    double length = sqrt(dot(normal, normal));
    return length > 0 ? fabs(dot(d, normal)) / length : 0;
}

/* NaN becomes `low`. */
static inline double clip(double number, double low, double high) {
    double at_least = number > low ? number : low;
    return at_least < high ? at_least : high;
}

/* Distances at which a ray enters and leaves a box; enter > leave is a miss. A ray within a face gives NaN, which
   the comparisons ignore. */
static inline void slab(const double *low, const double *high, const double *o, const double *inverse, double *enter,
                        double *leave) {
    for (int i = 0; i < 3; i++) {
        bool is_back = inverse[i] < 0;
        double near = ((is_back ? high : low)[i] - o[i]) * inverse[i];
        double far = ((is_back ? low : high)[i] - o[i]) * inverse[i];
        *enter = near > *enter ? near : *enter;
        *leave = far < *leave ? far : *leave;
    }
}

/* curved.c */
void fetch_face(const Curved *curved, int64_t k);
void tangents(const double *d, double axes[2][3]);
bool is_in_box(const Curved *curved, int64_t k, const double *o, const double axes[2][3]);
bool hit_curved(const Curved *curved, int64_t triangle, double u, double v, const double *o, const double *d,
                 const bool *leaves, double least, bool is_last, Hit *hit);

/* layers.c */
typedef struct {
    const Plan *plan;
    uint64_t mask;
    int64_t cluster, last_part, gap;
    double gap_distance;
    bool is_unready;
    double inverse[3]; /* of the direction's components */
} Sides;

void first_hit(const Layer *layer, Sides *sides, const double *o, const double *d, double within, Hit *hit);

/* plate.c */
double cross_array(const Array *array, Light light, double *position, double *direction, PlatePath *path);

/* trace.c */
double transmittance(double c1, double c2, double eta);

/* threads.c */
typedef void (*Work)(void *context, int64_t first, int64_t last);
typedef struct Begun Begun;
void share_out(Work work, void *context, int64_t n, int64_t at_once, int64_t n_threads);
Begun *begin_work(Work work, void *context, int64_t n, int64_t n_threads);

#endif
