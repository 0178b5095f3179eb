/* Trees of boxes, split by the surface area heuristic. */

#include <stdlib.h>

#include "kiriko.h"
#include "tree.h"

#define BINS 16
#define FEW 4          /* items of a block */
#define BY_HALVES 40   /* from this depth on, boxes are simply halved to limit the depth to MOST_DEPTH */
#define MOST_DEPTH 80

typedef struct {
    double low[3], high[3];
} Box;

/* A box of a binary tree: as Node, with two boxes instead of four. */
typedef struct {
    Box box;
    int32_t first, count;
} Pair;

static const Box NOTHING = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static void grow(Box *box, const double *low, const double *high) {
    for (int i = 0; i < 3; i++) {
        box->low[i] = low[i] < box->low[i] ? low[i] : box->low[i];
        box->high[i] = high[i] > box->high[i] ? high[i] : box->high[i];
    }
}

static double half_area(const Box *box) {
    double x = box->high[0] - box->low[0], y = box->high[1] - box->low[1], z = box->high[2] - box->low[2];
    return x < 0 ? 0 : x * y + y * z + z * x;
}

static double middle(const double *box, int axis) { return 0.5 * (box[axis] + box[3 + axis]); }

static int bin_of(double at, double low, double scale) {
    double bin = (at - low) * scale;
    return bin > 0 ? bin < BINS ? (int)bin : BINS - 1 : 0;
}

/* The axis and bin of the best split; false if there is none. */
static bool best_cut(const double *boxes, const int32_t *items, int32_t n, const Box *centres, int *axis, int *cut) {
    double best = INFINITY, scale[3];
    bool is_found = false;
    Box in_bin[3][BINS];
    int32_t counts[3][BINS] = {0};
    for (int a = 0; a < 3; a++) {
        scale[a] = BINS / (centres->high[a] - centres->low[a]);
        for (int b = 0; b < BINS; b++) in_bin[a][b] = NOTHING;
    }
    for (int32_t i = 0; i < n; i++) {
        const double *box = boxes + 6 * (int64_t)items[i];
        for (int a = 0; a < 3; a++) {
            int b = bin_of(middle(box, a), centres->low[a], scale[a]);
            grow(&in_bin[a][b], box, box + 3);
            counts[a][b]++;
        }
    }
    for (int a = 0; a < 3; a++) {
        if (!(centres->high[a] > centres->low[a])) continue;
        const Box *in = in_bin[a];
        const int32_t *count = counts[a];
        double after[BINS];
        Box grown = NOTHING;
        int32_t number = 0;
        for (int b = BINS - 1; b > 0; b--) {
            grow(&grown, in[b].low, in[b].high);
            number += count[b];
            after[b] = number * half_area(&grown);
        }
        grown = NOTHING;
        number = 0;
        for (int b = 1; b < BINS; b++) {
            grow(&grown, in[b - 1].low, in[b - 1].high);
            number += count[b - 1];
            double cost = number * half_area(&grown) + after[b];
            if (number && number < n && cost < best) {
                best = cost;
                *axis = a;
                *cut = b;
                is_found = true;
            }
        }
    }
    return is_found;
}

/* Make a binary tree; returns the number of boxes, 0 if cancelled. */
static int64_t make_pairs(const TreeTask *task, Pair *pairs, int32_t *items) {
    const double *boxes = task->boxes;
    int64_t n = task->n;
    struct { int32_t pair, first, count, depth; } todo[MOST_DEPTH + 2];
    int64_t n_pairs = 1;
    int n_todo = 1;
    for (int64_t i = 0; i < n; i++) items[i] = (int32_t)i;
    todo[0].pair = todo[0].first = todo[0].depth = 0;
    todo[0].count = (int32_t)n;

    while (n_todo) {
        if (task->is_cancelled) return 0;
        n_todo--;
        int32_t first = todo[n_todo].first, count = todo[n_todo].count, depth = todo[n_todo].depth;
        Pair *pair = pairs + todo[n_todo].pair;
        int32_t *mine = items + first;
        Box whole = NOTHING, centres = NOTHING;
        for (int32_t i = 0; i < count; i++) {
            const double *box = boxes + 6 * (int64_t)mine[i];
            double centre[3] = {middle(box, 0), middle(box, 1), middle(box, 2)};
            grow(&whole, box, box + 3);
            grow(&centres, centre, centre);
        }
        pair->box = whole;
        pair->first = first;
        pair->count = count;
        if (count <= FEW) continue;

        int axis = 0, cut = 0;
        int32_t n_before = 0;
        if (depth < BY_HALVES && best_cut(boxes, mine, count, &centres, &axis, &cut)) {
            double scale = BINS / (centres.high[axis] - centres.low[axis]);
            for (int32_t i = 0; i < count; i++) {
                const double *box = boxes + 6 * (int64_t)mine[i];
                if (bin_of(middle(box, axis), centres.low[axis], scale) >= cut) continue;
                int32_t item = mine[i];
                mine[i] = mine[n_before];
                mine[n_before++] = item;
            }
        }
        if (!n_before || n_before == count) n_before = count / 2; /* all in one place, or too deep: split anywhere */

        pair->first = (int32_t)n_pairs;
        pair->count = 0;
        for (int half = 0; half < 2; half++) {
            todo[n_todo].pair = (int32_t)n_pairs++;
            todo[n_todo].first = half ? first + n_before : first;
            todo[n_todo].count = half ? count - n_before : n_before;
            todo[n_todo].depth = depth + 1;
            n_todo++;
        }
    }
    return n_pairs;
}

static void make_tree(void *context, int64_t first_part, int64_t last_part) {
    (void)first_part;
    (void)last_part;
    TreeTask *task = context;
    Node *nodes = task->nodes;
    int64_t n = task->n, n_nodes = 1, n_todo = 1;
    Pair *pairs = malloc(2 * sizeof(Pair) * (size_t)n);
    int32_t *pair_of = malloc(2 * sizeof(int32_t) * (size_t)n); /* the pair represented by a node */
    int32_t *items = pair_of + n;
    int32_t todo[3 * MOST_DEPTH + 4]; /* nodes */
    if (!pairs || !pair_of || !make_pairs(task, pairs, items)) {
        free(pairs);
        free(pair_of);
        return;
    }
    pair_of[0] = 0;
    todo[0] = 0;
    while (n_todo) {
        int64_t i = todo[--n_todo]; /* the last first, so that subtrees are contiguous in memory */
        /* split the larger of a pair's two boxes, then the largest of three */
        int32_t of[4] = {pair_of[i]};
        int n_of = 1;
        while (n_of < 4) {
            int largest = -1;
            for (int k = 0; k < n_of; k++)
                if (!pairs[of[k]].count && (largest < 0 || half_area(&pairs[of[k]].box) > half_area(&pairs[of[largest]].box)))
                    largest = k;
            if (largest < 0) break;
            int32_t first = pairs[of[largest]].first;
            of[largest] = first;
            of[n_of++] = first + 1;
        }
        for (int k = 0; k < 4; k++) {
            const Pair *pair = k < n_of ? pairs + of[k] : NULL;
            for (int a = 0; a < 3; a++) {
                nodes[i].sides[2 * a][k] = pair ? (float)pair->box.low[a] - ROUNDING : INFINITY;
                nodes[i].sides[2 * a + 1][k] = pair ? (float)pair->box.high[a] + ROUNDING : -INFINITY;
            }
            nodes[i].unused[k] = nodes[i].children[k] = 0;
            if (pair && !pair->count) {
                pair_of[n_nodes] = of[k];
                todo[n_todo++] = nodes[i].children[k] = (int32_t)n_nodes++;
            } else if (pair) {
                nodes[i].children[k] = ~(int32_t)task->n_blocks;
                for (int m = 0; m < FEW; m++)
                    task->items[FEW * task->n_blocks + m] = items[pair->first + (m < pair->count ? m : pair->count - 1)];
                task->n_blocks++;
            }
        }
    }
    free(pairs);
    free(pair_of);
    task->n_nodes = n_nodes;
}

/* Start making a tree, in its own thread if n_threads is 2. NULL if memory is short; else call kiriko_end before any
   other access to the tree. */
KIRIKO_API Begun *kiriko_begin_tree(TreeTask *task, int64_t n_threads) {
    return begin_work(make_tree, task, task->n > 0, n_threads);
}
