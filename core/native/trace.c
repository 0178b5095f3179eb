/* Follows rays to their ends, ray by ray. The numpy reference is core/light/trace.py and the interactions. */

#include "kiriko.h"

#define NEAR 4.0 /* as in core/light/interaction_display.py */
#define RAYS_AT_ONCE 16 /* taken by a thread at a time: taking is free, and threads end at about the same time */
#define LEAST_THROUGHPUT 1e-4 /* as in core/light/rays.py */
#define EDGES_AT_ONCE 4 /* each with about ten rays */

typedef struct {
    const Plan *plan;
    Rays *rays;
    int64_t i, original; /* the row of the ray, and of the original ray if it is a copy */
    Hit *by_layer;
    const Hit *beneath; /* the display in contact with glass left by the ray; else NULL */
} Ray;

static void add_to_branch(Ray *ray, int64_t patch, Event event) {
    Rays *rays = ray->rays;
    int64_t i = ray->i;
    uint64_t word = (uint64_t)(patch * 8 + event + 1);
    uint64_t mixed = (rays->branch[i] ^ word) * UINT64_C(0x9E3779B97F4A7C15);
    rays->branch[i] = mixed ^ (mixed >> 29);
    if (!rays->course) return;
    int64_t at = rays->n_words[i]++;
    uint64_t *mine = rays->course + (rays->is_recorded ? i : ray->original) * rays->width + at;
    if (rays->is_recorded) {
        if (at < rays->width) *mine = rays->branch[i];
        return;
    }
    rays->is_astray[i] = (at < rays->width ? *mine : 0) != rays->branch[i];
    rays->has_ended[i] |= rays->is_astray[i];
}

/* Copy a ray that splits, in its present state, as Rays.split; returns the copy's row, -1 if no split is left. */
static int64_t split(Ray *ray) {
    Rays *rays = ray->rays;
    int64_t i = ray->i, digit = (1 + rays->n_copies) >> (1 + rays->n_splits[i]);
    if (!digit) return -1;
    int64_t to = i + rays->n_asked * digit;
    rays->n_splits[i]++;
    rays->is_begun[to] = true;
    copy(rays->positions + 3 * i, rays->positions + 3 * to);
    copy(rays->directions + 3 * i, rays->directions + 3 * to);
#define TAKE(column) rays->column[to] = rays->column[i]
    TAKE(mask), TAKE(cluster), TAKE(branch), TAKE(throughput), TAKE(absorption), TAKE(n_events), TAKE(rank), TAKE(n_splits), TAKE(n_words);
    TAKE(has_met_glass), TAKE(has_met_plate), TAKE(plate_path), TAKE(last_part), TAKE(leak), TAKE(is_astray);
#undef TAKE
    for (int64_t k = 0; rays->is_recorded && k < rays->width; k++)
        rays->course[to * rays->width + k] = rays->course[i * rays->width + k];
    for (int64_t k = 0; k < rays->n_steps && k < rays->n_events[i]; k++) {
        rays->met[k * rays->n_rays + to] = rays->met[k * rays->n_rays + i];
        copy(rays->places + 3 * (k * rays->n_rays + i), rays->places + 3 * (k * rays->n_rays + to));
    }
    return to;
}

/* Continue a ray as its transmitted light, and its reflected light in a copy, as Rays.branch_off; returns the copy's
   row, -1 without one. */
static int64_t branch_off(Ray *ray, double reflected, double transmitted, int64_t prefers) {
    Rays *rays = ray->rays;
    int64_t i = ray->i, to = -1;
    if (rays->throughput[i] * reflected >= LEAST_THROUGHPUT) to = split(ray);
    if (to >= 0) {
        rays->throughput[to] *= reflected;
        rays->rank[to] += prefers == TRANSMITTED_FIRST;
    }
    rays->throughput[i] *= transmitted;
    rays->rank[i] += prefers == REFLECTED_FIRST;
    if (rays->throughput[i] < LEAST_THROUGHPUT) {
        rays->reason[i] = BLOCKED;
        rays->has_ended[i] = true;
    }
    return to;
}

/* Remove a ray from open solids left through a gap: beyond the box, or without a hit. */
static void leave_gaps(Ray *ray, const Hit *hit) {
    const Plan *plan = ray->plan;
    Rays *rays = ray->rays;
    int64_t i = ray->i;
    const double *at = rays->positions + 3 * i;
    for (int64_t n = 0; n < plan->n_open; n++) {
        int64_t number = plan->open_part[n];
        if (!(rays->mask[i] & plan->bit[number]) || rays->cluster[i] != plan->cluster[number]) continue;
        if (hit) {
            const double *box = plan->open_box + 6 * n;
            int64_t part = hit->part;
            bool is_beyond = plan->bit[part] && plan->cluster[part] != plan->cluster[number];
            for (int j = 0; j < 3; j++) is_beyond |= at[j] < box[j] || at[j] > box[3 + j];
            if (!is_beyond || part == number) continue;
        }
        rays->mask[i] &= ~plan->bit[number];
        rays->absorption[i] = 0;
        rays->leak[i] = number;
    }
}

/* Mark the boxes of deferred objects that a ray enters. */
static void keep_clear(Ray *ray, double distance) {
    const Plan *plan = ray->plan;
    const double *o = ray->rays->positions + 3 * ray->i, *d = ray->rays->directions + 3 * ray->i;
    double inverse[3] = {1 / d[0], 1 / d[1], 1 / d[2]};
    for (int64_t n = 0; n < plan->n_deferred; n++) {
        const double *box = plan->deferred_box + 6 * n;
        double enter = -INFINITY, leave = INFINITY;
        slab(box, box + 3, o, inverse, &enter, &leave);
        if (enter <= leave && leave >= 0 && enter <= distance)
            __atomic_store_n(ray->rays->is_reached + n, 1, __ATOMIC_RELAXED);
    }
}

/* The cosine of the angle between a ray and the face it hits. */
static double cosine_at(const Ray *ray, const Hit *hit) {
    const double *d = ray->rays->directions + 3 * ray->i;
    return hit->is_curved ? cosine_of(d, hit->facing) : fabs(dot(d, ray->plan->normals + 3 * hit->triangle));
}

/* Whether the faces of two hits are within a perpendicular distance, m, as in core/light/hits.py. */
static bool are_near(const Ray *ray, const Hit *one, const Hit *other, double distance) {
    double along = fabs(one->distance - other->distance);
    return along <= distance || (along * cosine_at(ray, one) <= distance && along * cosine_at(ray, other) <= distance);
}

/* Order coincident hits of glass and display: glass left comes before the display, glass entered after it, as in
   core/light/interaction_display.py. */
static void put_in_order(Ray *ray, Hit *first) {
    const Plan *plan = ray->plan;
    const Hit *display = NULL, *glass = NULL;
    double near = NEAR * plan->merge_distance;
    for (int64_t n = 0; n < plan->n_layers; n++) {
        const Hit *hit = ray->by_layer + n;
        if (hit->triangle < 0) continue;
        if (hit->triangle >= plan->display_start) display = hit;
        bool leaves = plan->bit[hit->part] && !hit->enters;
        if (leaves && (!glass || hit->distance < glass->distance)) glass = hit;
    }
    if (!display) return;
    if (glass && are_near(ray, display, glass, near) &&
        (are_near(ray, display, first, near) || are_near(ray, glass, first, near))) {
        *first = *glass;
        ray->beneath = display;
    } else if (plan->kind[first->part] == GLASS && first->enters && are_near(ray, display, first, near)) {
        *first = *display;
    }
}

static bool find_first_hit(Ray *ray, Hit *first) {
    const Plan *plan = ray->plan;
    Rays *rays = ray->rays;
    int64_t i = ray->i;
    const double *o = rays->positions + 3 * i, *d = rays->directions + 3 * i;
    Sides sides = {plan, rays->mask[i], rays->cluster[i], rays->last_part[i], -1, INFINITY, false, {1 / d[0], 1 / d[1], 1 / d[2]}};
    double near = plan->is_by_glass ? NEAR * plan->merge_distance : 0;

    const Hit *nearest = NULL;
    for (int64_t n = 0; n < plan->n_layers; n++) {
        const Layer *layer = plan->layers + plan->order[n];
        double tolerance = layer->tolerance > plan->merge_distance ? layer->tolerance : plan->merge_distance;
        if (tolerance < near) tolerance = near;
        Hit *hit = ray->by_layer + plan->order[n];
        /* coincident faces are this far apart perpendicularly, and further along the ray */
        if (nearest && (layer->solid_bits || layer->has_engine || near > 0)) tolerance /= cosine_at(ray, nearest);
        first_hit(layer, &sides, o, d, nearest ? nearest->distance + tolerance : INFINITY, hit);
        if (hit->triangle >= 0 && (!nearest || hit->distance < nearest->distance)) nearest = hit;
    }
    if (sides.is_unready && rays->is_unready) __atomic_store_n(rays->is_unready, 1, __ATOMIC_RELAXED);
    *first = ray->by_layer[0];
    for (int64_t n = 1; n < plan->n_layers; n++)
        if (ray->by_layer[n].distance < first->distance) *first = ray->by_layer[n];
    ray->beneath = NULL;
    if (plan->is_by_glass && first->triangle >= 0) put_in_order(ray, first);
    if (plan->n_deferred) keep_clear(ray, first->distance);
    if (sides.gap_distance < first->distance) rays->leak[i] = sides.gap;
    return first->triangle >= 0;
}

/* Intersection of a ray with a flat display's plane: display px, distance, m, and whether from the front. */
static bool on_plane(const Ray *ray, double *xy, double *t) {
    const Plan *plan = ray->plan;
    const double *o = ray->rays->positions + 3 * ray->i, *d = ray->rays->directions + 3 * ray->i;
    double slope = dot(d, plan->plane_normal), away[3], at[3];
    for (int j = 0; j < 3; j++) away[j] = plan->plane_corner[j] - o[j];
    *t = dot(away, plan->plane_normal) / slope;
    for (int j = 0; j < 3; j++) at[j] = o[j] + *t * d[j] - plan->plane_corner[j];
    for (int k = 0; k < 2; k++) xy[k] = dot(plan->plane_pixels + 3 * k, at) + plan->plane_origin[k];
    return slope < 0 && *t > 0;
}

static bool is_on_image(const Plan *plan, const double *xy) {
    for (int k = 0; k < 2; k++) {
        double size = plan->display_size[k];
        if (!(xy[k] >= -EDGE * size && xy[k] <= (1 + EDGE) * size)) return false;
    }
    return true;
}

/* Set a ray's landing at a place of the display, px, as Display.pixel. */
static void land(Ray *ray, const double *xy) {
    ray->rays->xy[2 * ray->i] = xy[0];
    ray->rays->xy[2 * ray->i + 1] = xy[1];
}

/* Whether light passed by the glass, met the plate if one is required, and the settings follow such light. */
static bool is_beside_glass(const Ray *ray) {
    const Rays *rays = ray->rays;
    bool is_there = rays->has_met_plate[ray->i] || !ray->plan->needs_plate;
    return rays->reason[ray->i] == MISSED_GLASS && is_there && ray->plan->looks_beside;
}

static void end_without_hit(Ray *ray) {
    const Plan *plan = ray->plan;
    Rays *rays = ray->rays;
    int64_t i = ray->i;
    rays->reason[i] = rays->mask[i] ? LOST_INSIDE
                      : plan->has_glass && !rays->has_met_glass[i] ? MISSED_GLASS
                      : plan->needs_plate && !rays->has_met_plate[i] ? MISSED_PLATE
                      : MISSED_DISPLAY;
    double xy[2], t;
    if (!plan->has_plane || (rays->reason[i] != MISSED_DISPLAY && !is_beside_glass(ray))) return;
    if (!on_plane(ray, xy, &t)) return;
    land(ray, xy);
    add_to_branch(ray, plan->patch[plan->n_triangles - 1], LAND);
}

/* End a ray that can only meet a flat display. */
static void land_beyond_plate(Ray *ray) {
    const Plan *plan = ray->plan;
    Rays *rays = ray->rays;
    int64_t i = ray->i;
    rays->has_ended[i] = true;
    if (rays->n_events[i] >= plan->max_events) return;
    double xy[2], t;
    bool is_front = on_plane(ray, xy, &t), hits = t > 0 && is_on_image(plan, xy);
    if (hits) {
        for (int j = 0; j < 3; j++) rays->positions[3 * i + j] += t * rays->directions[3 * i + j];
        rays->n_events[i]++;
    }
    bool counts = rays->has_met_glass[i] || !plan->only_through_glass;
    rays->reason[i] = hits && !counts ? MISSED_GLASS
                      : hits && !is_front ? BLOCKED
                      : hits ? ARRIVED
                      : plan->has_glass && !rays->has_met_glass[i] ? MISSED_GLASS
                      : MISSED_DISPLAY;
    bool lands = rays->reason[i] == ARRIVED || rays->reason[i] == MISSED_DISPLAY || is_beside_glass(ray);
    if (!is_front || !lands) return;
    land(ray, xy);
    add_to_branch(ray, plan->patch[plan->n_triangles - 1], LAND);
}

/* Geometric and shading normal, both against the ray; returns whether the face's own one replaces a bent one facing
   away. */
static bool find_normals(const Plan *plan, const double *d, const Hit *hit, double *geometric, double *shading) {
    if (hit->is_curved) {
        copy(hit->facing, geometric);
        copy(hit->normal, shading);
        normalise(geometric);
        normalise(shading);
    } else {
        copy(plan->normals + 3 * hit->triangle, geometric);
        copy(geometric, shading);
    }
    if (plan->corner_normals && plan->is_bent[hit->triangle]) {
        const double *corners = plan->corner_normals + 9 * hit->triangle;
        double w = 1 - hit->u - hit->v;
        for (int j = 0; j < 3; j++) shading[j] = w * corners[j] + hit->u * corners[3 + j] + hit->v * corners[6 + j];
        normalise(shading);
    }
    if (!hit->enters)
        for (int j = 0; j < 3; j++) {
            geometric[j] = -geometric[j];
            shading[j] = -shading[j];
        }
    bool is_away = dot(d, shading) >= 0;
    if (is_away) copy(geometric, shading);
    return is_away;
}

static void reflect(const double *d, const double *normal, double *out) {
    double twice = 2.0 * dot(d, normal);
    for (int j = 0; j < 3; j++) out[j] = d[j] - twice * normal[j];
}

/* Unpolarised Fresnel transmittance of power; 0 at grazing incidence. */
double transmittance(double c1, double c2, double eta) {
    double s = (eta * c1 - c2) / (eta * c1 + c2), p = (c1 - eta * c2) / (c1 + eta * c2);
    s = s == s ? s : 1;
    p = p == p ? p : 1;
    return 1.0 - 0.5 * (s * s + p * p);
}

/* Snell's law, as optics.refract; returns whether light is totally reflected. */
static bool refract(const double *d, const double *normal, double n1, double n2, double *out, double *passed) {
    double eta = n1 / n2, c = -dot(d, normal), tangential[3];
    for (int j = 0; j < 3; j++) tangential[j] = d[j] + c * normal[j];
    double k = c * c + (n2 - n1) / n2 * (1.0 + eta) * dot(tangential, tangential);
    if (k < 0) {
        reflect(d, normal, out);
        *passed = 1;
        return true;
    }
    double root = sqrt(k);
    for (int j = 0; j < 3; j++) out[j] = eta * d[j] + (eta * c - root) * normal[j];
    *passed = transmittance(c, root, eta);
    return false;
}

/* Reflect by the shading normal, or by the geometric one if that would send light through; returns whether it did. */
static bool reflect_before(const double *d, const double *geometric, const double *shading, double *out) {
    reflect(d, shading, out);
    if (dot(out, geometric) >= 0) return false;
    reflect(d, geometric, out);
    return true;
}

/* Row of the tables of media for a mask at the surface of a solid. */
static int64_t medium_of(int64_t part, uint64_t mask) {
    return (N_BITS + 1) * part + (mask ? 64 - __builtin_clzll(mask) : 0);
}

/* Continue a ray in the medium of a mask, at the surface of a solid. */
static void enter(Ray *ray, int64_t part, uint64_t mask) {
    ray->rays->mask[ray->i] = mask;
    if (ray->plan->absorptions) ray->rays->absorption[ray->i] = ray->plan->absorptions[medium_of(part, mask)];
}

static void set_direction(Ray *ray, double *out) {
    normalise(out);
    copy(out, ray->rays->directions + 3 * ray->i);
}

/* Refract or totally reflect at an interface; coincident faces of other solids are crossed together. */
static void interact_glass(Ray *ray, const Hit *hit) {
    const Plan *plan = ray->plan;
    Rays *rays = ray->rays;
    int64_t i = ray->i, part = hit->part;
    uint64_t before = rays->cluster[i] == plan->cluster[part] ? rays->mask[i] : 0;
    rays->cluster[i] = plan->cluster[part];
    uint64_t after = before ^ plan->bit[part];
    int64_t patch = plan->patch[hit->triangle]; /* the smallest number of coincident faces names the branch */
    for (int64_t n = 0; n < plan->n_layers; n++) {
        const Hit *other = ray->by_layer + n;
        if (other->triangle < 0 || other->triangle == hit->triangle) continue;
        if (plan->cluster[other->part] != plan->cluster[part]) continue; /* a mask belongs to one cluster */
        if (!are_near(ray, other, hit, plan->merge_distance)) continue;
        after ^= plan->bit[other->part];
        if (plan->patch[other->triangle] < patch) patch = plan->patch[other->triangle];
    }
    double n1 = plan->indices[medium_of(part, before)], n2 = plan->indices[medium_of(part, after)];
    rays->has_met_glass[i] = true;
    if (n1 == n2) {
        enter(ray, part, after);
        return;
    }
    const double *d = rays->directions + 3 * i;
    double geometric[3], shading[3], out[3], passed;
    bool is_own = find_normals(plan, d, hit, geometric, shading);
    bool is_tir = refract(d, shading, n1, n2, out, &passed);
    /* a bent normal can send light to the wrong side of the face: use the face's own normal, at the cost of a
       discontinuity */
    if ((dot(out, geometric) > 0) != is_tir) {
        is_tir = refract(d, geometric, n1, n2, out, &passed);
        is_own = true;
    }
    const Split *splits = plan->elements[part];
    if (splits && !is_tir) {
        Ray other = *ray;
        other.i = branch_off(ray, 1 - passed, passed, splits->prefers);
        passed = 1; /* it counts already */
        if (other.i >= 0) {
            double mirrored[3];
            bool is_face = reflect_before(d, geometric, shading, mirrored);
            set_direction(&other, mirrored);
            rays->last_part[other.i] = part;
            rays->mask[other.i] = before;
            add_to_branch(&other, patch, is_own || is_face ? FACE_TIR : TIR);
        }
    }
    set_direction(ray, out);
    if (is_tir) rays->last_part[i] = part;
    enter(ray, part, is_tir ? before : after);
    if (plan->brightness) rays->throughput[i] *= passed;
    Event event = is_own ? (is_tir ? FACE_TIR : FACE_PASS) : (is_tir ? TIR : PASS);
    add_to_branch(ray, patch, event);
}

static void interact_plate(Ray *ray, const Hit *hit) {
    const Plan *plan = ray->plan;
    Rays *rays = ray->rays;
    int64_t i = ray->i, part = hit->part;
    const double *normal = plan->normals + 3 * hit->triangle;
    double *d = rays->directions + 3 * i, out[3];
    const Array *array = plan->elements[part];
    if (array) {
        Light light = (Light)rays->light;
        if (rays->has_met_plate[i] && light == REFLECTED_LIGHT) light = FOLDED_LIGHT; /* reflected only once */
        PlatePath path;
        double passed = cross_array(array, light, rays->positions + 3 * i, d, &path);
        if (rays->plate_path[i] <= IMAGED) rays->plate_path[i] = (uint8_t)path;
        if (plan->brightness) rays->throughput[i] *= passed;
    } else {
        reflect(d, normal, out); /* the tangential component is reversed, the normal one is unchanged */
        for (int j = 0; j < 3; j++) d[j] = -out[j];
        if (rays->plate_path[i] < IMAGED) rays->plate_path[i] = IMAGED;
    }
    rays->has_met_plate[i] = true;
    add_to_branch(ray, plan->patch[hit->triangle], AT_PLATE);
    if (plan->is_clear[2 * part + (dot(d, normal) > 0)]) land_beyond_plate(ray);
}

static void interact_mirror(Ray *ray, const Hit *hit) {
    const double *d = ray->rays->directions + 3 * ray->i;
    double geometric[3], shading[3], out[3];
    bool is_own = find_normals(ray->plan, d, hit, geometric, shading);
    is_own |= reflect_before(d, geometric, shading, out);
    set_direction(ray, out);
    add_to_branch(ray, ray->plan->patch[hit->triangle], is_own ? AT_MIRROR_FACE : AT_MIRROR);
}

/* Continue straight, and reflected in a copy. */
static void interact_half_mirror(Ray *ray, const Hit *hit) {
    const Split *splits = ray->plan->elements[hit->part];
    Ray other = *ray;
    other.i = branch_off(ray, splits->reflectance, splits->transmittance, splits->prefers);
    if (other.i >= 0) interact_mirror(&other, hit);
    add_to_branch(ray, ray->plan->patch[hit->triangle], PASS);
}

static void interact_retroreflector(Ray *ray, const Hit *hit) {
    double *d = ray->rays->directions + 3 * ray->i;
    for (int j = 0; j < 3; j++) d[j] = -d[j];
    add_to_branch(ray, ray->plan->patch[hit->triangle], AT_MIRROR);
}

/* Bend by the paraxial law of a thin lens. */
static void interact_lens(Ray *ray, const Hit *hit) {
    const double *lens = ray->plan->elements[hit->part], *normal = ray->plan->normals + 3 * hit->triangle;
    const double *at = ray->rays->positions + 3 * ray->i, *d = ray->rays->directions + 3 * ray->i;
    double away[3], out[3], slope = fabs(dot(d, normal));
    for (int j = 0; j < 3; j++) away[j] = at[j] - lens[j];
    double height = dot(away, normal);
    for (int j = 0; j < 3; j++) out[j] = d[j] / slope - (away[j] - height * normal[j]) / lens[3];
    set_direction(ray, out);
    add_to_branch(ray, ray->plan->patch[hit->triangle], PASS);
}

/* End on the display; lands on its front if the light has met the required parts. */
static void interact_display(Ray *ray, const Hit *hit) {
    const Plan *plan = ray->plan;
    Rays *rays = ray->rays;
    int64_t i = ray->i;
    bool is_front = dot(rays->directions + 3 * i, plan->normals + 3 * hit->triangle) < 0;
    bool counts = rays->has_met_glass[i] || !plan->only_through_glass;
    bool is_too_early = plan->needs_plate && !rays->has_met_plate[i] && rays->light == IMAGED_LIGHT;
    rays->reason[i] = !counts ? MISSED_GLASS : is_too_early ? MISSED_PLATE : !is_front ? BLOCKED : ARRIVED;
    add_to_branch(ray, plan->patch[hit->triangle], LAND);
    if (rays->reason[i] != ARRIVED && !(is_front && is_beside_glass(ray))) return;
    const double *uv = plan->display_uv + 6 * (hit->triangle - plan->display_start);
    double w = 1 - hit->u - hit->v, at[2];
    for (int k = 0; k < 2; k++) at[k] = w * uv[k] + hit->u * uv[2 + k] + hit->v * uv[4 + k];
    double xy[2] = {at[0] * plan->display_size[0], (1 - at[1]) * plan->display_size[1]};
    land(ray, xy);
    if (rays->reason[i] == ARRIVED && !is_on_image(plan, xy)) rays->reason[i] = MISSED_DISPLAY; /* beyond the image */
}

/* End a ray that left glass in contact with the display; a reflected one must not hit the display behind it. */
static void leave_onto_display(Ray *ray, uint64_t before) {
    const Plan *plan = ray->plan;
    Rays *rays = ray->rays;
    int64_t i = ray->i;
    if (rays->mask[i] == before) {
        rays->last_part[i] = plan->sheet[ray->beneath->part];
        return;
    }
    rays->has_ended[i] = true;
    if (rays->n_events[i] >= plan->max_events) return;
    rays->n_events[i]++;
    interact_display(ray, ray->beneath);
}

static void follow_one(Ray *ray) {
    const Plan *plan = ray->plan;
    Rays *rays = ray->rays;
    int64_t i = ray->i;
    bool is_noted = rays->n_steps > 0;
    for (int64_t event = rays->n_events[i]; event < plan->max_events; event++) {
        Hit hit;
        if (!find_first_hit(ray, &hit)) {
            leave_gaps(ray, NULL);
            end_without_hit(ray);
            if (is_noted) rays->left_at[i] = event;
            return;
        }
        double *at = rays->positions + 3 * i, *d = rays->directions + 3 * i;
        for (int j = 0; j < 3; j++) at[j] += hit.distance * d[j];
        if (plan->absorptions) rays->throughput[i] *= exp(-rays->absorption[i] * hit.distance);
        rays->n_events[i]++;
        leave_gaps(ray, &hit);
        if (is_noted && event < rays->n_steps) {
            copy(at, rays->places + 3 * (event * rays->n_rays + i));
            rays->met[event * rays->n_rays + i] = hit.triangle + 1;
        }
        int64_t part = hit.part;
        Kind kind = (Kind)plan->kind[part];
        /* glass coincident with the thin surface just left: do not hit the surface again from there */
        bool is_coincident = kind == GLASS && hit.distance * cosine_at(ray, &hit) <= plan->merge_distance;
        if (!is_coincident) rays->last_part[i] = plan->sheet[part];
        uint64_t before = rays->mask[i];
        switch (kind) {
            case GLASS: interact_glass(ray, &hit); break;
            case PLATE: interact_plate(ray, &hit); break;
            case MIRROR: interact_mirror(ray, &hit); break;
            case HALF_MIRROR: interact_half_mirror(ray, &hit); break;
            case RETROREFLECTOR: interact_retroreflector(ray, &hit); break;
            case LENS: interact_lens(ray, &hit); break;
            case BLOCKER: rays->reason[i] = BLOCKED; return;
            case DISPLAY: interact_display(ray, &hit); return;
        }
        if (ray->beneath) leave_onto_display(ray, before);
        if (rays->has_ended[i]) return;
    }
}

typedef struct {
    const Plan *plan;
    Rays *rays;
    int64_t first;
} Batch;

static void follow_some(void *context, int64_t first, int64_t last) {
    Batch *batch = context;
    Hit by_layer[MOST_LAYERS];
    Rays *rays = batch->rays;
    Ray ray = {batch->plan, rays, 0, 0, by_layer, NULL};
    for (int64_t i = first; i < last; i++) {
        ray.i = ray.original = batch->first + i;
        follow_one(&ray);
        /* its copies, which may split as well, into later rows */
        for (int64_t k = 0; k < rays->n_copies; k++) {
            ray.i += rays->n_asked;
            if (rays->is_begun[ray.i] && !rays->has_ended[ray.i]) follow_one(&ray);
        }
    }
}

/* Follow rays from `first` to before `last` to their ends. The result does not depend on the number of threads. */
KIRIKO_API void kiriko_follow(const Plan *plan, Rays *rays, int64_t first, int64_t last, int64_t n_threads) {
    Batch batch = {plan, rays, first};
    share_out(follow_some, &batch, last - first, RAYS_AT_ONCE, n_threads);
}

/* Start the ray through a viewer pixel, as in core/rig/viewer.py and core/light/rays.py. */
static void begin(const Halving *halving, Rays *rays, int64_t i, double x, double y) {
    const double *window = halving->window, *right = halving->axes, *up = right + 3, *forward = right + 6;
    double u = window[0] + (window[1] - window[0]) * (x / halving->size[0]);
    double v = window[3] + (window[2] - window[3]) * (y / halving->size[1]);
    double *o = rays->positions + 3 * i, *d = rays->directions + 3 * i, square = 0;
    for (int k = 0; k < 3; k++) {
        double across = u * right[k] + v * up[k];
        o[k] = halving->is_orthographic ? across + halving->position[k] : halving->position[k];
        d[k] = halving->is_orthographic ? forward[k] : forward[k] + across;
        square += d[k] * d[k];
    }
    double length = halving->is_orthographic ? 1 : sqrt(square);
    for (int k = 0; k < 3; k++) d[k] /= length;
    rays->mask[i] = rays->branch[i] = 0;
    rays->cluster[i] = rays->n_events[i] = rays->n_words[i] = rays->rank[i] = rays->n_splits[i] = 0;
    rays->reason[i] = CUT_OFF;
    rays->xy[2 * i] = rays->xy[2 * i + 1] = NAN;
    rays->throughput[i] = 1;
    rays->absorption[i] = 0;
    rays->has_met_glass[i] = rays->has_met_plate[i] = rays->is_astray[i] = rays->has_ended[i] = false;
    rays->plate_path[i] = NONE;
    rays->last_part[i] = rays->leak[i] = -1;
}

/* Whether an edge has its branch at a fraction 0..1 of its length; if so, records it as the last place. */
static bool holds(const Halving *halving, Ray *ray, double part) {
    Rays *rays = ray->rays;
    int64_t i = ray->i;
    const double *start = halving->start + 2 * i, *way = halving->way + 2 * i;
    begin(halving, rays, i, start[0] + part * way[0], start[1] + part * way[1]);
    follow_one(ray);
    halving->n_tried[i]++;
    uint64_t branch = rays->is_astray[i] || !isfinite(rays->xy[2 * i]) ? 0 : rays->branch[i] ? rays->branch[i] : 1;
    if (branch != halving->branch[i]) return false;
    halving->low[i] = part;
    halving->throughput[i] = rays->throughput[i];
    for (int k = 0; k < 2; k++) halving->xy[2 * i + k] = rays->xy[2 * i + k];
    return true;
}

typedef struct {
    Batch batch;
    const Halving *halving;
} Halves;

static void halve_some(void *context, int64_t first, int64_t last) {
    const Halves *halves = context;
    const Halving *halving = halves->halving;
    Hit by_layer[MOST_LAYERS];
    Ray ray = {halves->batch.plan, halves->batch.rays, 0, 0, by_layer, NULL};
    for (int64_t n = first; n < last; n++) {
        int64_t i = ray.i = ray.original = halves->batch.first + n;
        /* try the expected end first, unless it is the far end */
        if (halving->width[i] < 1 && holds(halving, &ray, halving->width[i])) halving->width[i] = 0;
        while (halving->width[i] > halving->least) {
            halving->width[i] /= 2;
            holds(halving, &ray, halving->low[i] + halving->width[i]);
        }
    }
}

/* Bisect edges from `first` to before `last` for the last places on their branches, each with the state of one ray.
   The result does not depend on the number of threads. */
KIRIKO_API void kiriko_bisect(const Plan *plan, Rays *rays, const Halving *halving, int64_t first, int64_t last,
                              int64_t n_threads) {
    Halves halves = {{plan, rays, first}, halving};
    share_out(halve_some, &halves, last - first, EDGES_AT_ONCE, n_threads);
}

/* Number i for loading.py's check of the layout; -1 beyond the last. */
KIRIKO_API int64_t kiriko_layout(int64_t i) {
    const int64_t numbers[] = {
        VERSION,       MOST_LAYERS,   sizeof(Node), sizeof(Tree), sizeof(Curved),  sizeof(EngineTriangles),
        sizeof(Layer), sizeof(Array), sizeof(Split), sizeof(Plan), sizeof(Rays), sizeof(Division),
        sizeof(FlatTaps), sizeof(Level), sizeof(KeptTaps), sizeof(Fit), sizeof(ThinParts), sizeof(Paths),
        sizeof(Halving), sizeof(Sum), sizeof(TreeTask),
    };
    return i >= 0 && i < (int64_t)(sizeof numbers / sizeof *numbers) ? numbers[i] : -1;
}
