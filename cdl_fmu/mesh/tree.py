"""A hierarchy of axis-parallel boxes over triangles, each with up to ``LEAF`` of them at its ends, and the features that these own."""

from __future__ import annotations

import numpy as np

from ..slave.kernel import kernel

LEAF = 4  # triangles

#: Columns of a node. The left child of a node is the next one; RIGHT = 0 says that it has no children, but triangles, edges and vertices
#: from FIRST to LAST - 1. An edge or vertex belongs to one triangle, and edges are the convex ones only.
RIGHT, FIRST_TRIANGLE, LAST_TRIANGLE, FIRST_EDGE, LAST_EDGE, FIRST_VERTEX, LAST_VERTEX = range(7)
NODE = 7


def build(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split boxes at the median of the longest side of their middles, again and again.

    Args:
        low, high: Least and largest x, y, z of each triangle [m], shape [n, 3].

    Returns:
        order: Triangles in the order of the leaves, [n].
        nodes: Depth first, [n_nodes, NODE], with RIGHT and the triangles of leaves filled in.
        boxes: Middle and half sides of each node's box [m], [n_nodes, 6].
    """
    middle = 0.5 * (low + high)
    order = np.arange(len(low))
    nodes, boxes = [], []

    def split(first: int, last: int) -> None:
        here = order[first:last]
        a, b = low[here].min(axis=0), high[here].max(axis=0)
        node = [0] * NODE
        nodes.append(node)
        boxes.append((*(0.5 * (a + b)), *(0.5 * (b - a))))
        if last - first <= LEAF:
            node[FIRST_TRIANGLE], node[LAST_TRIANGLE] = first, last
            return
        at = middle[here]
        half = (last - first) // 2
        order[first:last] = here[np.argpartition(at[:, np.ptp(at, axis=0).argmax()], half)]
        split(first, first + half)
        node[RIGHT] = len(nodes)
        split(first + half, last)

    split(0, len(low))
    return order, np.array(nodes, np.int64), np.array(boxes)


@kernel(inline=True)
def distance_to_box(boxes, i, x, y, z):
    """Square of the distance [m2] of a point from box i; 0 within."""
    d_x = max(abs(x - boxes[i, 0]) - boxes[i, 3], 0.0)
    d_y = max(abs(y - boxes[i, 1]) - boxes[i, 4], 0.0)
    d_z = max(abs(z - boxes[i, 2]) - boxes[i, 5], 0.0)
    return d_x * d_x + d_y * d_y + d_z * d_z
