/* Near misses of bundles of rays, bundle by bundle. The numpy reference is core/light/near_misses.py. */

#include "kiriko.h"

#define WIDEST 0.0625 /* as in near_misses.py */
#define BUNDLES_EACH_TURN 16

/* The rays of a bundle between two of their events, and the cone around them: start and extent of its upper and
   lower line along each axis. */
typedef struct {
    const double *start[MOST_BUNDLED], *end[MOST_BUNDLED];
    int64_t n;
    double from[2][3], extent[2][3];
} Bundle;

static void find_cone(Bundle *b) {
    int64_t middle = b->n / 2;
    double radius[2] = {0, 0};
    for (int64_t r = 0; r < b->n; r++) {
        double off[2][3];
        for (int a = 0; a < 3; a++) {
            off[0][a] = b->start[r][a] - b->start[middle][a];
            off[1][a] = b->end[r][a] - b->end[middle][a];
        }
        for (int i = 0; i < 2; i++) {
            double square = dot(off[i], off[i]);
            if (square > radius[i]) radius[i] = square;
        }
    }
    double before = sqrt(radius[0]), more = sqrt(radius[1]) - before;
    for (int a = 0; a < 3; a++) {
        double start = b->start[middle][a], extent = b->end[middle][a] - start;
        b->from[0][a] = start + before;
        b->from[1][a] = start - before;
        b->extent[0][a] = extent + more + 0.0; /* never -0.0 */
        b->extent[1][a] = extent - more + 0.0;
    }
}

/* Whether the cone meets a box: on all axes at once, it must be above the lower side and below the upper one. */
static bool hits_box(const Bundle *b, const double *box) {
    double enter = 0, leave = 1;
    for (int i = 0; i < 2; i++) {
        for (int a = 0; a < 3; a++) {
            double extent = b->extent[i][a], at = (box[3 * i + a] - b->from[i][a]) / extent;
            if ((extent >= 0) == (i == 0)) {
                if (at > enter) enter = at;
            } else if (at < leave) leave = at;
        }
    }
    return enter <= leave;
}

static double sign(double number) { return number > 0 ? 1 : number < 0 ? -1 : 0; }

/* Whether the convex hull of the rays touches a triangle. It does not if all rays stay on one side of the plane, or
   pass beyond the same edge. */
static bool touches(const Bundle *b, const double *frame) {
    double height[2][MOST_BUNDLED], u[2][MOST_BUNDLED], v[2][MOST_BUNDLED], least = INFINITY, most = -INFINITY;
    for (int64_t r = 0; r < b->n; r++) {
        for (int i = 0; i < 2; i++) {
            const double *at = i ? b->end[r] : b->start[r];
            double inside[3];
            for (int a = 0; a < 3; a++) inside[a] = at[a] - frame[a];
            height[i][r] = dot(inside, frame + 3);
            u[i][r] = dot(inside, frame + 6);
            v[i][r] = dot(inside, frame + 9);
            if (height[i][r] < least) least = height[i][r];
            if (height[i][r] > most) most = height[i][r];
        }
    }
    if (!(least <= 0 && most >= 0)) return false;

    /* The hull meets the plane at the crossings of rays, and between these and the other rays: from the first
       crossing on, or up to the last if the others start behind the plane. */
    double t[MOST_BUNDLED], first = 1, last = 0, ahead = 0;
    bool crosses[MOST_BUNDLED];
    for (int64_t r = 0; r < b->n; r++) {
        double before = height[0][r], after = height[1][r];
        crosses[r] = before * after <= 0;
        t[r] = before == after ? 0 : before / (before - after);
        if (!crosses[r]) continue;
        if (t[r] < first) first = t[r];
        if (t[r] > last) last = t[r];
        ahead += before;
    }
    double greatest[2][3];
    for (int i = 0; i < 2; i++) {
        for (int e = 0; e < 3; e++) greatest[i][e] = -INFINITY;
        for (int64_t r = 0; r < b->n; r++) {
            bool is_ahead = sign(height[0][r]) == sign(ahead);
            double place = crosses[r] ? t[r] : i ? (is_ahead ? 1 : last) : (is_ahead ? first : 0);
            double x = u[0][r] + place * (u[1][r] - u[0][r]), y = v[0][r] + place * (v[1][r] - v[0][r]);
            const double sides[3] = {x, y, 1 - x - y};
            for (int e = 0; e < 3; e++)
                if (sides[e] > greatest[i][e]) greatest[i][e] = sides[e];
        }
    }
    for (int e = 0; e < 3; e++)
        /* a triangle without area has no coordinates, so a miss cannot be proven */
        if (greatest[0][e] < 0 && greatest[1][e] < 0 && isfinite(greatest[0][e] + greatest[1][e])) return false;
    return true;
}

/* Whether a bundle comes near a triangle in a box of a level. The boxes of the last level hold one each. */
static bool comes_near(const ThinParts *parts, const Bundle *b, int level, int64_t box) {
    if (!hits_box(b, parts->boxes[level] + 6 * box)) return false;
    if (level == N_LEVELS - 1) return touches(b, parts->frames + 12 * box);
    const int64_t *children = parts->children[level];
    for (int64_t k = children[box]; k < children[box + 1]; k++)
        if (comes_near(parts, b, level + 1, k)) return true;
    return false;
}

/* Whether rays come near a patch that none of them hit. They are followed until they part or diverge. */
static bool pass_by(const ThinParts *parts, const Paths *paths, const int64_t *rays) {
    uint64_t is_met[MOST_UNITS / 64] = {0};
    int64_t n = paths->n_rays, m = paths->n_events;
    const int32_t *met[MOST_BUNDLED];
    for (int64_t r = 0; r < n; r++) {
        met[r] = paths->met + rays[r] * m;
        for (int64_t e = 0; e < m; e++) {
            if (met[r][e] < 0 || met[r][e] >= parts->n_patches) continue;
            int64_t unit = parts->unit_of_patch[met[r][e]];
            is_met[unit / 64] |= (uint64_t)1 << (unit % 64);
        }
    }
    for (int64_t e = 0; e < m; e++) {
        Bundle bundle = {.n = n};
        double off = 0;
        bool leaves = false, parts_here = false, is_lost = false;
        for (int64_t r = 0; r < n; r++) {
            bundle.start[r] = paths->places + 3 * (rays[r] * (m + 1) + e);
            bundle.end[r] = bundle.start[r] + 3;
            for (int a = 0; a < 3; a++) {
                double away = fabs(bundle.end[r][a] - bundle.end[0][a]);
                is_lost |= away != away;
                if (away > off) off = away;
            }
            leaves |= met[r][e] < 0;
            parts_here |= met[r][e] != met[0][e];
        }
        /* rays leaving the rig are followed far beyond it: allow the bundle to be as wide as the rig */
        bool is_wide = !is_lost && off > (leaves ? paths->widest / WIDEST : paths->widest);
        if (is_wide) return e == 0 && !parts_here; /* wide before the first event: near to everything */
        if (is_lost) return false;
        find_cone(&bundle);
        for (int64_t unit = 0; unit < parts->n_units; unit++) {
            if (is_met[unit / 64] >> (unit % 64) & 1) continue;
            if (comes_near(parts, &bundle, 0, unit)) return true;
        }
        if (parts_here) return false;
    }
    return false;
}

typedef struct {
    const ThinParts *parts;
    const Paths *paths;
} Query;

static void query_some(void *context, int64_t first, int64_t last) {
    const Query *query = context;
    const Paths *paths = query->paths;
    for (int64_t i = first; i < last; i++)
        paths->touched[i] = pass_by(query->parts, paths, paths->rays + i * paths->n_rays);
}

/* Mark the bundles that come near a patch that none of their rays hit. */
KIRIKO_API void kiriko_touch(const ThinParts *parts, const Paths *paths, int64_t n_threads) {
    if (paths->n_rays < 1 || paths->n_rays > MOST_BUNDLED || parts->n_units > MOST_UNITS) return;
    Query query = {parts, paths};
    share_out(query_some, &query, paths->n, BUNDLES_EACH_TURN, n_threads > 1 ? n_threads : 1);
}
