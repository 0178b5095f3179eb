/* Trees of boxes: a ray visits the boxes it meets, four at a time and nearest first. */

#ifndef TREE_H
#define TREE_H

#include <string.h>

#include "kiriko.h"

#define MOST_WAITING 256 /* boxes: three for each level of a tree, with at most 80 levels */
#define ROUNDING 1e-6f   /* margin of the float32 boxes, in units of the tree's size */

/* Callback for the items of a block; it may lower `far`, the limit of the search. */
typedef void (*Visit)(void *context, int32_t block, double *far);

typedef float Floats __attribute__((vector_size(16), aligned(4)));
typedef int32_t Ints __attribute__((vector_size(16), aligned(4)));
typedef uint64_t Keys __attribute__((vector_size(16)));

/* Swap two keys unless the greater comes first. */
static inline void order(uint64_t *a, uint64_t *b) {
    uint64_t less = *a < *b ? *a : *b, more = *a < *b ? *b : *a;
    *a = more;
    *b = less;
}

/* Visit the items whose boxes a ray meets between 0 and far, all in units of the tree's size.

   along : inverse components of the direction */
__attribute__((always_inline)) static inline void visit_tree(const Tree *tree, const double *o, const double *along,
                                                             double *far, Visit visit, void *context) {
    uint64_t waiting[MOST_WAITING]; /* a box: the bits of its distance, as great as itself, and its node or block */
    Floats from[3], inverse[3];
    int near_side[3], n = 1;
    for (int a = 0; a < 3; a++) {
        float at = (float)o[a], one = (float)along[a];
        from[a] = (Floats){at, at, at, at};
        inverse[a] = (Floats){one, one, one, one};
        near_side[a] = 2 * a + (one < 0);
    }
    waiting[0] = 0;
    float least = (float)*far * (1 + ROUNDING) + ROUNDING;

    while (n) {
        uint64_t next = waiting[--n];
        uint32_t bits = (uint32_t)(next >> 32);
        int32_t child = (int32_t)(uint32_t)next;
        float distance;
        memcpy(&distance, &bits, sizeof distance);
        if (distance > least) continue;
        if (child < 0) {
            visit(context, ~child, far);
            least = (float)*far * (1 + ROUNDING) + ROUNDING;
            continue;
        }
        const Node *node = tree->nodes + child;
        Floats enter = {0, 0, 0, 0}, leave = {least, least, least, least};
        for (int a = 0; a < 3; a++) {
            Floats t0 = (*(const Floats *)node->sides[near_side[a]] - from[a]) * inverse[a];
            Floats t1 = (*(const Floats *)node->sides[near_side[a] ^ 1] - from[a]) * inverse[a];
            for (int k = 0; k < 4; k++) { /* both comparisons ignore the NaN of a ray within a side */
                enter[k] = t0[k] > enter[k] ? t0[k] : enter[k];
                leave[k] = t1[k] < leave[k] ? t1[k] : leave[k];
            }
        }
        /* the nearest last, so that it is popped first; boxes not met become zeros after it */
        Ints is_met = enter <= leave, children = *(const Ints *)node->children & is_met, distances = (Ints)enter & is_met;
        Keys low = (Keys)__builtin_shufflevector(children, distances, 0, 4, 1, 5);
        Keys high = (Keys)__builtin_shufflevector(children, distances, 2, 6, 3, 7);
        uint64_t *keys = waiting + n, a = low[0], b = low[1], c = high[0], e = high[1];
        n += (a > 0) + (b > 0) + (c > 0) + (e > 0);
        order(&a, &b);
        order(&c, &e);
        order(&a, &c);
        order(&b, &e);
        order(&b, &c);
        keys[0] = a;
        keys[1] = b;
        keys[2] = c;
        keys[3] = e;
    }
}

#endif
