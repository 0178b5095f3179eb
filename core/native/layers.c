/* The first true hit of a ray in a layer, ray by ray. The numpy reference is core/light/ray_engine.py. */

#include "kiriko.h"
#include "tree.h"

#define STEEP 0.5 /* cosine, and fraction of a triangle's size: limits for a ray only leaving the bounding shell */
#define NEAR 0.1
#define SHELL_SLACK 1e-9 /* barycentric, so that no ray slips between two triangles of the shell */
#define MOST_SHELL_HITS 200  /* shell triangles hit by one ray, whose steps double each time */

typedef struct {
    const Layer *layer;
    Sides *sides;
    const double *o, *d, *inverse; /* 1 / d */
    const bool *leaves;
    double axes[2][3]; /* of the ray, for curved faces */
    double start;    /* start of the search in the tree, m */
    double least;    /* closer hits belong to the surface just left */
    double tolerance, slack;
    double wrong;    /* distance of the nearest impossible hit, unless a shell intersects itself */
    bool is_inside;  /* of a closed solid */
    int64_t deeper;  /* faces of such a shell passed: entered minus left */
    double passed;   /* distance of the last one */
    int64_t last;    /* its triangle, -1 if it was not a valid hit */
    Hit *hit;
} Search;

/* Whether a hit is true, by the sides of its face (docs/decisions/01-true-hits.md). is_wrong: the hit is impossible. */
static bool accept(Search *search, const Hit *hit, bool *is_wrong) {
    Sides *sides = search->sides;
    const Plan *plan = sides->plan;
    int64_t only = search->layer->only_part;
    int64_t part = only < 0 ? plan->part[search->layer->numbers[hit->triangle]] : only;
    uint64_t bit = plan->bit[part];
    double t = hit->distance, tolerance = search->tolerance;
    bool fits = hit->enters != ((sides->mask & bit) && sides->cluster == plan->cluster[part]);
    bool is_last = plan->sheet[part] == sides->last_part;
    bool is_behind = bit && !fits && t > tolerance;
    if (is_behind) { /* and away from the ray's origin */
        const double *normal = hit->is_curved ? hit->facing : search->layer->frames + 12 * hit->triangle + 3;
        is_behind = t * cosine_of(search->d, normal) > tolerance;
    }
    *is_wrong = is_behind && plan->is_closed[part];
    if (is_behind && !plan->is_closed[part] && t < sides->gap_distance) {
        sides->gap = part;
        sides->gap_distance = t;
    }
    /* touching faces may lie slightly behind; other faces of the surface just left may not, however thin it is */
    if (bit) return fits && t > (is_last ? -1e-3 : -1.0) * tolerance;
    return t > tolerance || (!is_last && t > -1e-3 * tolerance);
}

/* Pass a face of a self-intersecting shell, as in core/light/layer_hits.py; returns whether it is a new one. */
static bool pass(Search *search, double t, int64_t triangle, bool is_wrong) {
    if (!(t > search->passed + search->layer->tolerance)) return false;
    search->deeper += is_wrong ? 1 : -1;
    search->passed = t;
    search->last = is_wrong ? -1 : triangle;
    return true;
}

/* Two numbers in one vector register. */
typedef double Two __attribute__((vector_size(16)));
typedef int64_t Truth __attribute__((vector_size(16))); /* of two comparisons */

static Two two_at(const float *from) { return (Two){from[0], from[1]}; }

static Two dot_two(const Two *a, const Two *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross_two(const Two *a, const Two *b, Two *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static bool any(Truth is) { return is[0] | is[1]; }

static Truth are_within(Two u, Two v, double slack) { return (u >= -slack) & (v >= -slack) & (u + v <= 1 + slack); }

/* Intersection of a ray with the plane of a triangle; false if parallel. */
static bool hit_plane(const Search *search, const double *frame, int64_t k, Hit *hit) {
    const double *corner = frame, *normal = frame + 3;
    const double *o = search->o, *d = search->d;
    double slope = dot(d, normal), away[3], inside[3];
    for (int j = 0; j < 3; j++) away[j] = corner[j] - o[j];
    double t = dot(away, normal) / slope;
    for (int j = 0; j < 3; j++) inside[j] = o[j] + t * d[j] - corner[j];
    hit->distance = t;
    hit->u = dot(inside, frame + 6);
    hit->v = dot(inside, frame + 9);
    hit->triangle = k;
    hit->enters = slope < 0;
    hit->is_curved = false;
    return isfinite(t);
}

/* Keep a hit if it is true and the nearest so far. */
static void consider(Search *search, const Hit *found, double *far) {
    bool is_wrong;
    if (!(found->distance > search->least) || !(found->distance < search->hit->distance)) return;
    if (accept(search, found, &is_wrong)) {
        *search->hit = *found;
        double left = (found->distance - search->start + search->tolerance) / search->layer->radius;
        if (far && left < *far) *far = left;
    } else if (is_wrong && found->distance < search->wrong) {
        search->wrong = found->distance;
    }
}

/* Intersect n facets, with a slack at their edges, two at a time. Keeps a hit up to `within` if it is true and the
   nearest
   so far.

   numbers : of their triangles; NULL: in order */
static void hit_facets(Search *search, const double *frames, const int32_t *numbers, int64_t n, double within,
                        double *far) {
    const double *o = search->o, slack = search->slack;
    Two d[3];
    for (int j = 0; j < 3; j++) d[j] = (Two){search->d[j], search->d[j]};
    for (int64_t i = 0; i < n; i += 2) {
        int n_here = i + 1 < n ? 2 : 1;
        const double *frame = frames + 12 * i, *other = frame + 12 * (n_here - 1);
        Two corner[3], normal[3], axis_u[3], axis_v[3], away[3], inside[3];
        for (int j = 0; j < 3; j++) {
            corner[j] = (Two){frame[j], other[j]};
            normal[j] = (Two){frame[3 + j], other[3 + j]};
            axis_u[j] = (Two){frame[6 + j], other[6 + j]};
            axis_v[j] = (Two){frame[9 + j], other[9 + j]};
            away[j] = corner[j] - o[j];
        }
        Two slope = dot_two(d, normal), t = dot_two(away, normal) / slope;
        for (int j = 0; j < 3; j++) inside[j] = o[j] + t * d[j] - corner[j];
        Two u = dot_two(inside, axis_u), v = dot_two(inside, axis_v);
        Truth is_met = (t > search->least) & (t < search->hit->distance) & (t <= within) & are_within(u, v, slack);
        if (!any(is_met)) continue;
        for (int k = 0; k < n_here; k++) {
            if (!is_met[k]) continue;
            Hit found = {.distance = t[k], .u = u[k], .v = v[k], .enters = slope[k] < 0};
            found.triangle = numbers ? numbers[i + k] : i + k;
            consider(search, &found, far);
        }
    }
}

static void visit_faces(void *context, int32_t block, double *far) {
    Search *search = context;
    const Layer *layer = search->layer;
    const Curved *curved = layer->curved;
    const int32_t *items = layer->over_faces.items + 4 * (int64_t)block;
    const double *facets = layer->facets + 48 * (int64_t)block;
    if (!curved) {
        hit_facets(search, facets, items, 4, INFINITY, far);
        return;
    }
    for (int i = 0; i < 4; i++) {
        int32_t k = items[i];
        Hit found;
        if (i && k == items[i - 1]) return;
        if (curved->row[k] < 0) {
            hit_facets(search, facets + 12 * i, items + i, 1, INFINITY, far);
            continue;
        }
        if (!is_in_box(curved, k, search->o, search->axes)) continue;
        for (int s = 0; s < layer->n_starts; s++)
            if (hit_curved(curved, k, STARTS[s][0], STARTS[s][1], search->o, search->d, search->leaves, layer->tolerance,
                            true, &found))
                consider(search, &found, far);
    }
}

/* Whether the nearest face found must be passed, so the search continues beyond it. */
static bool has_passed(Search *search) {
    if (!search->is_inside) return false;
    bool is_wrong = search->wrong < search->hit->distance;
    double t = is_wrong ? search->wrong : search->hit->distance;
    if (!is_wrong && !(search->deeper && search->hit->triangle >= 0)) return false;
    /* rounding may swap two coincident faces */
    if (is_wrong && !search->deeper && search->hit->distance <= t + search->layer->tolerance) return false;
    pass(search, t, -1, is_wrong);
    search->least = t + search->layer->tolerance;
    search->wrong = search->hit->distance = INFINITY;
    search->hit->triangle = -1;
    return true;
}

/* Test all faces the ray may hit, exactly. */
static void search_faces(Search *search, double slack, double far) {
    const Layer *layer = search->layer;
    double from[3];
    search->slack = slack;
    search->wrong = INFINITY;
    if (layer->curved) tangents(search->d, search->axes);
    for (int j = 0; j < 3; j++) from[j] = (search->o[j] + search->start * search->d[j] - layer->centre[j]) / layer->radius;
    far = (far + search->tolerance - search->start) / layer->radius;
    visit_tree(&layer->over_faces, from, search->inverse, &far, visit_faces, search);
}

/* A ray and its first hit on the bounding shell: place on the triangle, and normal with twice its area as length. */
typedef struct {
    const EngineTriangles *shell;
    const Layer *layer; /* to prefetch the faces behind; may be NULL */
    const double *o, *d;
    bool is_outside; /* of the glass, so it may only be leaving the shell */
    double gone;     /* distance travelled before o */
    double u, v, normal[3];
    int32_t position;
} Shot;

/* Whether a ray at a triangle of the shell is only leaving it, having left the faces behind it. */
static bool only_leaves_shell(const Shot *shot, int32_t position, const double *normal, double along, double t) {
    if (!(along > 0)) return false;
    double area = sqrt(dot(normal, normal)), far = shot->gone + t;
    bool is_steep = along > STEEP * area, is_near = far * far < NEAR * NEAR * area;
    return is_steep && is_near && shot->shell->tree.items[position] >= shot->shell->n_whole;
}

/* Record the triangle at a position as the first hit. */
static void take_shot(Shot *shot, int32_t position, double u, double v, const double *normal) {
    const EngineTriangles *shell = shot->shell;
    shot->position = position;
    shot->u = u;
    shot->v = v;
    copy(normal, shot->normal);
    if (!shot->layer) return;
    /* prefetch the face behind it while the tree is searched */
    int64_t k = shell->owner[position], part = shell->tree.items[position] - shell->n_whole;
    if (part >= 0) __builtin_prefetch(shell->places + 6 * part);
    __builtin_prefetch(shot->layer->numbers + k);
    fetch_face(shot->layer->curved, k);
}

static void visit_shell(void *context, int32_t block, double *far) {
    Shot *shot = context;
    const float(*corners)[4] = (const float(*)[4])shot->shell->corners + 9 * (int64_t)block;
    const double *o = shot->o;
    Two d[3];
    for (int j = 0; j < 3; j++) d[j] = (Two){shot->d[j], shot->d[j]};
    for (int i = 0; i < 4; i += 2) {
        Two e1[3], e2[3], away[3], normal[3], across[3];
        for (int j = 0; j < 3; j++) {
            Two corner = two_at(corners[j] + i);
            e1[j] = two_at(corners[3 + j] + i) - corner;
            e2[j] = two_at(corners[6 + j] + i) - corner;
            away[j] = o[j] - corner;
        }
        cross_two(e1, e2, normal);
        Two slope = -dot_two(d, normal), inverse = 1.0 / slope, t = dot_two(away, normal) * inverse;
        cross_two(away, d, across);
        Two u = dot_two(e2, across) * inverse, v = -dot_two(e1, across) * inverse;
        Truth is_met = (t > 0.0) & (t < *far) & are_within(u, v, SHELL_SLACK);
        if (!any(is_met)) continue;
        for (int k = 0; k < 2; k++) {
            if (!(is_met[k] && t[k] < *far)) continue; /* the first may now be nearer */
            double own_normal[3] = {normal[0][k], normal[1][k], normal[2][k]};
            int32_t position = 4 * block + i + k;
            if (shot->is_outside && only_leaves_shell(shot, position, own_normal, -slope[k], t[k])) continue;
            *far = t[k];
            take_shot(shot, position, u[k], v[k], own_normal);
        }
    }
}

/* Follow a ray from one triangle of the shell to the next until there is a true hit. Returns whether a face was
   missed. */
static bool search_shell(Search *search, double enter) {
    const Layer *layer = search->layer;
    const Curved *curved = layer->curved;
    const EngineTriangles *shell = layer->engine_triangles;
    const double *o = search->o, *d = search->d, radius = layer->radius;
    double step = 3 * FLOAT32 * radius, start = enter > 0 ? enter - 2 * layer->tolerance : step;
    const bool from_outside = false;
    bool is_lost = false;

    for (int n_hits = 0; n_hits < MOST_SHELL_HITS; n_hits++) {
        double from[3], far = INFINITY;
        for (int j = 0; j < 3; j++) from[j] = (o[j] + start * d[j] - layer->centre[j]) / radius;
        Shot shot = {.shell = shell, .layer = layer, .o = from, .d = d, .position = -1};
        shot.is_outside = search->leaves && !*search->leaves;
        shot.gone = start / radius;
        visit_tree(&shell->tree, from, search->inverse, &far, visit_shell, &shot);
        if (shot.position < 0) break;
        double at = start + far * radius;
        int32_t primitive = shell->tree.items[shot.position];
        int64_t k = shell->owner[shot.position];
        __builtin_prefetch(search->sides->plan->patch + layer->numbers[k]);
        Hit found;
        bool is_met, is_wrong = false;
        if (curved->row[k] < 0) {
            is_met = hit_plane(search, layer->frames + 12 * k, k, &found);
        } else {
            double u = shot.u, v = shot.v;
            if (primitive >= shell->n_whole) {
                const float *at_corner = shell->places + 6 * (primitive - shell->n_whole);
                double w = 1 - shot.u - shot.v;
                u = w * at_corner[0] + shot.u * at_corner[2] + shot.v * at_corner[4];
                v = w * at_corner[1] + shot.u * at_corner[3] + shot.v * at_corner[5];
            }
            is_met = hit_curved(curved, k, u, v, o, d, search->leaves, layer->tolerance, false, &found);
            /* entering again before leaving: a self-intersecting shell */
            Hit into;
            if (search->is_inside && search->leaves && dot(d, shot.normal) < 0 && !(is_met && found.distance <= at) &&
                hit_curved(curved, k, u, v, o, d, &from_outside, layer->tolerance, false, &into) && into.enters &&
                into.distance > fmax(search->passed, 0) + layer->tolerance &&
                !(is_met && found.distance < into.distance)) {
                found = into;
                is_met = true;
            }
        }
        if (is_met) {
            bool is_true = accept(search, &found, &is_wrong);
            /* the same face may be hit behind several shell triangles, and rounding may swap two coincident faces */
            bool is_here = fabs(found.distance - search->passed) <= layer->tolerance;
            bool is_same = is_here && found.triangle == search->last;
            bool is_swapped = is_here && search->last < 0 && search->deeper == 1;
            if (is_true && (!search->deeper || is_swapped) && !is_same) {
                *search->hit = found;
                return is_lost;
            }
            is_lost |= is_wrong && !search->is_inside;
            if (search->is_inside && (is_true || is_wrong) &&
                pass(search, found.distance, found.triangle, is_wrong)) {
                step = 3 * FLOAT32 * radius;
                n_hits = 0;
            }
        }
        start = (at > start ? at : start) + step;
        step *= 2;
    }
    return is_lost || search->is_inside;
}

/* Test all of a few triangles. */
static void search_few(Search *search, double within) {
    const Layer *layer = search->layer;
    search->slack = EDGE;
    hit_facets(search, layer->frames, NULL, layer->n_triangles, within, NULL);
}

static void turn(const double *rotation, bool is_back, double *vector) {
    double from[3];
    copy(vector, from);
    for (int i = 0; i < 3; i++) {
        vector[i] = 0;
        for (int j = 0; j < 3; j++) vector[i] += rotation[is_back ? 3 * j + i : 3 * i + j] * from[j];
    }
}

static void find(Search *search, double enter, double within) {
    const Layer *layer = search->layer;
    Sides *sides = search->sides;
    bool is_inside = search->is_inside;

    if (!layer->has_engine) {
        if (is_inside) within = INFINITY; /* or a self-intersecting shell would seem to end too early */
        do search_few(search, within);
        while (has_passed(search));
        if (search->hit->triangle >= 0 || search->passed == -INFINITY) return;
        search->least = -layer->tolerance; /* unbalanced counts: not a self-intersection */
        search_few(search, within);
        return;
    }

    bool is_lost;
    if (layer->curved) {
        is_lost = search_shell(search, enter);
    } else {
        /* a vertex or an edge hits several faces at once: one is enough, unless it is the only exit */
        if (!(enter > 0)) search->least = 3 * FLOAT32 * layer->radius;
        do {
            search_faces(search, EDGE, is_inside ? INFINITY : within);
        } while (has_passed(search));
        is_lost = search->wrong < search->hit->distance || (is_inside && search->hit->triangle < 0);
    }
    if (!is_lost) return;
    if (!layer->over_faces.nodes) {
        sides->is_unready = true;
        return;
    }
    /* any hit found may lie beyond a missed face: test all faces, with more slack */
    Hit previous = *search->hit;
    search->hit->distance = INFINITY;
    search->hit->triangle = -1;
    search->least = -layer->tolerance;
    search_faces(search, WIDER, INFINITY);
    if (search->hit->triangle < 0) *search->hit = previous;
}

/* The first true hit of a ray in a layer; its triangle is numbered as in the plan. */
void first_hit(const Layer *layer, Sides *sides, const double *o, const double *d, double within, Hit *hit) {
    double from[3], along[3], turned[3], enter = -INFINITY, leave = INFINITY;
    const double *inverse = sides->inverse;
    hit->distance = INFINITY;
    hit->triangle = -1;
    hit->is_curved = false;
    if (layer->rotation) {
        for (int j = 0; j < 3; j++) from[j] = o[j] - layer->shift[j];
        copy(d, along);
        turn(layer->rotation, true, from);
        turn(layer->rotation, true, along);
        for (int j = 0; j < 3; j++) turned[j] = 1 / along[j];
        o = from;
        d = along;
        inverse = turned;
    }
    slab(layer->low, layer->high, o, inverse, &enter, &leave);
    bool is_inside = sides->mask & layer->closed_bits[sides->cluster];
    if (!((enter <= leave && enter <= within && leave >= 0) || is_inside)) return;
    if (!isfinite(o[0] + o[1] + o[2] + d[0] + d[1] + d[2])) return; /* or without a direction */

    bool leaves = layer->solid_bits && sides->mask & layer->solid_bits[sides->cluster];
    double merge = sides->plan->merge_distance;
    Search search = {
        .layer = layer,
        .sides = sides,
        .o = o,
        .d = d,
        .inverse = inverse,
        .leaves = layer->curved && layer->solid_bits ? &leaves : NULL,
        .tolerance = layer->tolerance > merge ? layer->tolerance : merge,
        .start = (enter > 0 ? enter : 0) - 2 * layer->tolerance,
        .least = -layer->tolerance,
        .wrong = INFINITY,
        .is_inside = is_inside,
        .passed = -INFINITY,
        .last = -1,
        .hit = hit,
    };
    find(&search, enter, within);
    if (hit->triangle < 0) return;
    hit->triangle = layer->numbers[hit->triangle];
    hit->part = layer->only_part < 0 ? sides->plan->part[hit->triangle] : layer->only_part;
    if (hit->is_curved && layer->rotation) {
        turn(layer->rotation, false, hit->facing);
        turn(layer->rotation, false, hit->normal);
    }
}
