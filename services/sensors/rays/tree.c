// SPDX-License-Identifier: Apache-2.0
/* A tree of boxes: a box is split in the middle of its longest side, as long as that parts its items.
 */

#include <math.h>

#include "rays.h"

/* Deeper than this, items are parted in halves, wherever they are: there are less than 2^31. */
#define SPACE_DEPTH (MOST_DEPTH - 32)

static struct node leaf(const struct box *boxes, const int32_t *order, int32_t first, int32_t items)
{
    struct node node = {.first = first, .items = items, .box = boxes[order[first]]};
    for (int32_t i = first + 1; i < first + items; i++)
        for (int axis = 0; axis < 3; axis++) {
            const struct box *box = &boxes[order[i]];
            node.box.low[axis] = fminf(node.box.low[axis], box->low[axis]);
            node.box.high[axis] = fmaxf(node.box.high[axis], box->high[axis]);
        }
    return node;
}

/* Bring items whose middle is below that of the node to its front; return where they end. */
static int32_t parted(const struct box *boxes, int32_t *order, const struct node *node)
{
    const float *low = node->box.low, *high = node->box.high;
    int axis = high[1] - low[1] > high[0] - low[0];
    if (high[2] - low[2] > high[axis] - low[axis])
        axis = 2;
    int32_t end = node->first;
    for (int32_t i = node->first; i < node->first + node->items; i++) {
        const int32_t item = order[i];
        if (boxes[item].low[axis] + boxes[item].high[axis] < low[axis] + high[axis]) {
            order[i] = order[end];
            order[end++] = item;
        }
    }
    return end;
}

static void split(const struct box *boxes, int32_t *order, struct node *nodes, int32_t *used,
                  int32_t leaf_items, int32_t number, int depth)
{
    struct node *node = &nodes[number];
    const int32_t first = node->first, end = first + node->items;
    if (node->items <= leaf_items)
        return;
    int32_t middle = depth < SPACE_DEPTH ? parted(boxes, order, node) : first;
    if (middle == first || middle == end)
        middle = first + node->items / 2;
    const int32_t child = *used;
    *used += 2;
    nodes[child] = leaf(boxes, order, first, middle - first);
    nodes[child + 1] = leaf(boxes, order, middle, end - middle);
    node->first = child;
    node->items = 0;
    split(boxes, order, nodes, used, leaf_items, child, depth + 1);
    split(boxes, order, nodes, used, leaf_items, child + 1, depth + 1);
}

/* Build the tree of one or more boxes: `order` for as many items, `nodes` for twice as many. */
void groundlink_tree(const struct box *boxes, int32_t count, int32_t leaf_items, int32_t *order,
                     struct node *nodes)
{
    int32_t used = 1;
    for (int32_t i = 0; i < count; i++)
        order[i] = i;
    nodes[0] = leaf(boxes, order, 0, count);
    split(boxes, order, nodes, &used, leaf_items, 0, 0);
}
