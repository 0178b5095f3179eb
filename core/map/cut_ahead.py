"""What is still to come while pixels are cut in pieces, for the progress alone."""

from collections.abc import Sequence

from ..arrays import Bools, Ints
from ..light.plan import Plan
from ..steps import Pauses
from .cut_cells import Sides, around_middles, find_sides
from .doubts import Doubts
from .faint import may_take_more
from .known_borders import Borders
from .points import Points
from .ray_guess import N_SEARCHES, RAYS, Rays, RaysAhead, area_of, rays_of_cut
from .share_guess import SharesOfPieces, more_shares


class CutAhead:
    """Tells `ahead` of rays, cells, pieces and their shares that are still to come.

    kinds : the pieces so far, triangles and quads
    last : (n, 5) corners and middles of cells that are cut around their middles at the end
    chaotic : (c, 4) cells that are sampled instead

    These lists are those of whoever cuts, and grow: of each part of `last` edges are counted once.
    """

    def __init__(
        self,
        plan: Plan,
        ahead: RaysAhead,
        kinds: Sequence[list[Ints]],
        last: list[Ints],
        chaotic: list[Ints],
    ) -> None:
        self.plan, self.ahead = plan, ahead
        self.kinds, self.last, self.chaotic = kinds, last, chaotic
        self._shares = SharesOfPieces(plan)
        self._edges_of_last: list[tuple[int, int]] = []

    def expect(
        self, points: Points, known: Borders, sides: Sides, depth: int, of_one: Sequence[int]
    ) -> Pauses[None]:
        """Before borders are looked for on sides of cells that were quartered so often: the rays to
        find these, to cut the cells that were left for the end, and to sample; and the cells that
        are to be put together.

        of_one : how many cells on one branch there are besides, and how many of these are bent
        """
        for some in self.last[len(self._edges_of_last) :]:
            of_last = yield from find_sides(points, around_middles(some), known)
            yield 0
            self._edges_of_last.append(of_last.n_edges)
        yield 0
        n_last = [sum(n) for n in zip((0, 0), *self._edges_of_last, strict=True)]
        n_one, n_bent = of_one
        rays = rays_of_cut(self.plan, points, (sides.n_edges, n_last), depth, self.chaotic)
        rays = rays.and_more(Rays(searches=N_SEARCHES - depth))
        n_anew = 0.0
        if n_bent:
            rays = rays.and_more(Rays(RAYS.of_bent[depth] * n_bent))
            n_anew = RAYS.cells_of_bent[depth] * n_bent
        self.ahead.expect(rays)
        self.ahead.sums_light = may_take_more(self.plan, area_of(points, self.chaotic))
        self.ahead.n_to_join = len(sides.cells) + n_one + n_anew + self._n_last
        yield 0

    def take_up(
        self, points: Points, found: Doubts, is_sampled: Bools, is_quartered: Bools, depth: int
    ) -> None:
        """After cells (m,), quartered so often, were put together: those of them that are sampled
        instead, and those that are quartered next.
        """
        n_quartered = int(is_quartered.sum())
        n_shares = self._shares.take_up(points, found, is_sampled, is_quartered)
        n_shares = more_shares(n_shares, depth, n_quartered + self._n_last)
        n_anew = RAYS.cells_of_bent[depth] * n_quartered
        n_pieces = sum(len(some) for kind in self.kinds for some in kind)
        self.ahead.n_shares = n_shares
        self.ahead.n_pieces = n_pieces + n_anew + 4 * self._n_last
        self.ahead.join(len(found.is_one), n_anew + self._n_last)

    def end(self, points: Points, pieces: list[Ints]) -> None:
        """After all pieces, of some kinds, are there."""
        self.ahead.n_shares = self._shares.of_all(points, pieces)
        self.ahead.n_pieces = sum(map(len, pieces))
        self.ahead.join(self._n_last, 0.0)

    @property
    def _n_last(self) -> int:
        return sum(map(len, self.last))
