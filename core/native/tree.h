/* Trees of boxes: a ray visits the boxes it meets, four at a time and nearest first. */

#ifndef TREE_H
#define TREE_H

#include "kiriko.h"

#define MOST_WAITING 256 /* boxes: three for each level of a tree, with at most 80 levels */
#define ROUNDING 1e-6f   /* margin of the float32 boxes, in units of the tree's size */

/* Callback for the items from position `first` to before `last`; it may lower `far`, the limit of the search. */
typedef void (*Visit)(void *context, int32_t first, int32_t last, double *far);

/* Visit the items whose boxes a ray meets between 0 and far, all in units of the tree's size. */
__attribute__((always_inline)) static inline void visit_tree(const Tree *tree, const double *o, const double *d,
                                                             double *far, Visit visit, void *context) {
    struct { int32_t first, count; float enter; } waiting[MOST_WAITING];
    float from[3], inverse[3];
    int side[3], n = 1;
    for (int a = 0; a < 3; a++) {
        from[a] = (float)o[a];
        inverse[a] = (float)(1 / d[a]);
        side[a] = inverse[a] < 0;
    }
    waiting[0].first = waiting[0].count = 0;
    waiting[0].enter = 0;

    while (n) {
        n--;
        float least = (float)*far * (1 + ROUNDING) + ROUNDING;
        if (waiting[n].enter > least) continue;
        int32_t first = waiting[n].first;
        if (waiting[n].count) {
            visit(context, first, first + waiting[n].count, far);
            continue;
        }
        const Node *node = tree->nodes + first;
        float enter[4] = {0, 0, 0, 0}, leave[4] = {least, least, least, least};
        for (int a = 0; a < 3; a++) {
            const float *near_side = node->sides[2 * a + side[a]], *far_side = node->sides[2 * a + 1 - side[a]];
            for (int k = 0; k < 4; k++) {
                /* both comparisons ignore the NaN of a ray within a side */
                float t0 = (near_side[k] - from[a]) * inverse[a], t1 = (far_side[k] - from[a]) * inverse[a];
                enter[k] = t0 > enter[k] ? t0 : enter[k];
                leave[k] = t1 < leave[k] ? t1 : leave[k];
            }
        }
        for (int k = 0; k < 4; k++) {
            if (node->first[k] < 0 || !(enter[k] <= leave[k])) continue;
            int at = n++; /* the nearest last, so that it is popped first */
            for (; at > 0 && waiting[at - 1].enter < enter[k] && at > n - 4; at--) waiting[at] = waiting[at - 1];
            waiting[at].first = node->first[k];
            waiting[at].count = node->count[k];
            waiting[at].enter = enter[k];
        }
    }
}

#endif
