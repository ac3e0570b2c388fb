"""Loops of a graph of bodies and joints: as many independent ones as there are joints outside of a spanning tree."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from stiffscope.vjm.mechanism import GROUND

if TYPE_CHECKING:
    from collections.abc import Sequence

    Way = list[tuple[int, float]]
    Edges = Sequence[tuple[str, str]]


def tree(edges: Edges) -> tuple[dict[str, Way], list[int]]:
    """Ways from the ground to every body, breadth first, and the joints outside of this tree.

    ``edges``: the two bodies of each joint. A way is joints by number, -1 beside one that is gone backwards.
    """
    paths: dict[str, Way] = {GROUND: []}
    queue, used = deque([GROUND]), set[int]()
    while queue:
        here = queue.popleft()
        for k, (first, second) in enumerate(edges):
            there = second if here == first else first if here == second else None
            if there is not None and there not in paths:
                paths[there] = [*paths[here], (k, 1.0 if here == first else -1.0)]
                used.add(k)
                queue.append(there)
    return paths, [k for k in range(len(edges)) if k not in used]


def loops(edges: Edges, paths: dict[str, Way], chords: list[int]) -> list[Way]:
    """One loop for each chord, the shortest first, through the tree and chords that were taken before it."""
    open_edges = {k for path in paths.values() for k, _ in path}
    out: list[Way] = []
    left = list(chords)
    while left:
        found = {k: [(k, 1.0), *_shortest(edges, open_edges, edges[k][1], edges[k][0])] for k in left}
        best = min(left, key=lambda k: len(found[k]))
        out.append(found[best])
        open_edges.add(best)
        left.remove(best)
    return out


def _shortest(edges: Edges, some: set[int], start: str, end: str) -> Way:
    ways: dict[str, Way] = {start: []}
    queue = deque([start])
    while end not in ways:
        here = queue.popleft()
        for k in sorted(some):
            first, second = edges[k]
            there = second if here == first else first if here == second else None
            if there is not None and there not in ways:
                ways[there] = [*ways[here], (k, 1.0 if here == first else -1.0)]
                queue.append(there)
    return ways[end]
