"""Sharpening: the light of the display that viewers with pupils see nearest to the ideal images.

With the seen image A x of a viewer, the mean over places of its pupil, the light x minimises

    f(x) = 1/2 sum_v w_v |A_v x - t_v|^2,  black <= x <= white,

for targets t_v: the ideal image on the part of each viewer pixel that shows the display. The light
of red, green and blue is independent. The gradient is sum_v w_v A_v^T (A_v x - t_v). All entries of
A are positive, so the diagonal d = sum_v w_v A_v^T A_v 1 exceeds the matrix (De Pierro, A modified
expectation maximization algorithm for penalized likelihood estimation in emission tomography, IEEE
Trans. Medical Imaging 14, 1995, 132-137), and a step of gradient / d never overshoots. Steps are
accelerated (Beck and Teboulle, A fast iterative shrinkage-thresholding algorithm for linear inverse
problems, SIAM J. Imaging Sciences 2, 2009, 183-202) and restart if one makes f larger (O'Donoghue
and Candes, Adaptive restart for accelerated gradient schemes, Found. Comp. Math. 15, 2015).
"""

from collections.abc import Generator, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..base.fingerprint import fingerprint
from ..base.free_memory import is_free
from ..base.messages import Message
from ..base.stages import section
from ..base.steps import Steps, hold_progress, subprogress
from ..image.seen_image import ideal_image
from ..image.seen_quality import SeenQuality, quality
from ..light.plan import Plan
from ..map.shares import ShareBatches, add_at
from .channel import channel_keys
from .through_pupil import PupilViews

SHARPENING = Message("sharpening")
TRACED = 0.5  # progress of a sharpening once all places of pupils are traced
LEAST_GAIN = 1e-3  # fraction of the painted image's f that a step has to remove
MOST_STEPS = 200
BYTES_OF_ENTRY = 32
AT_ONCE = 1 << 18  # entries between two pauses
WHOLE = 1 - 1e-6  # cover of a pixel that shows only the display


class Entries(NamedTuple):
    """Entries (n,) of a sparse matrix: viewer pixel, display pixel, weight, and area, px^2."""

    view: NDArray[np.integer]
    display: NDArray[np.integer]
    weight: Floats
    area: Floats


def _merged(parts: list[Entries], display_size: tuple[int, int]) -> list[Entries]:
    """Entries with a sum for each pair of pixels, which places of a sharp pupil share, in parts."""
    if not parts:
        return parts
    view, display, *sums = map(np.concatenate, zip(*parts, strict=True))
    pair = view.astype(np.int64) * np.prod(display_size) + display
    order = np.argsort(pair, kind="stable")
    first = np.flatnonzero(np.diff(pair[order], prepend=-1))
    sums = [np.add.reduceat(one[order], first) for one in sums]
    merged = Entries(view[order][first], display[order][first], *sums)
    starts = range(0, len(first), AT_ONCE)
    return [Entries(*(one[k : k + AT_ONCE] for one in merged)) for k in starts]


class SeenMatrix:
    """The matrix A from a display's light to the image that a viewer's pupil sees.

    Entries are cached if they fit into memory, else made again for each product.
    """

    def __init__(self, views: PupilViews) -> None:
        self._batches: Sequence[ShareBatches] = views.batches
        self.view_size = self._batches[0].view_size
        self.display_size = self._batches[0].display_size
        self._cached: list[Entries] | None = None

    def entries(self) -> Iterator[Entries | None]:
        """Its entries in batches; None is a pause."""
        if self._cached is not None:
            yield from self._cached
            return
        cached: list[Entries] = []
        n_bytes, has_room = 0, True
        for batches in self._batches:
            for shares in batches.pausing():
                yield None
                if shares is None:
                    continue
                area = shares.area / len(self._batches)
                weight = area if shares.throughput is None else area * shares.throughput
                one = Entries(shares.view_index, shares.display_index, weight, area)
                n_bytes += BYTES_OF_ENTRY * len(area)
                has_room = has_room and is_free(n_bytes)  # as much again stays free
                cached = [*cached, one] if has_room else []
                yield one
        self._cached = _merged(cached, self.display_size) if has_room else None

    def cover(self) -> Steps[Floats]:
        """Part (h, w) of each viewer pixel that shows the display, 0..1."""
        cover = np.zeros(self.view_size[::-1])
        for one in self.entries():
            yield 0
            if one is not None:
                add_at(cover, one.view, one.area)
        return np.minimum(cover, 1.0)

    def seen(self, light: Floats) -> Steps[Floats]:
        """A x: (3, h, w) for light (3, H, W)."""
        seen = np.zeros((len(light), *self.view_size[::-1]))
        for one in self.entries():
            yield 0
            if one is not None:
                for image, x in zip(seen, light, strict=True):
                    add_at(image, one.view, one.weight * x.ravel()[one.display])
        return seen

    def back(self, image: Floats) -> Steps[Floats]:
        """A^T r: (3, H, W) for images (3, h, w)."""
        light = np.zeros((len(image), *self.display_size[::-1]))
        for one in self.entries():
            yield 0
            if one is not None:
                for x, r in zip(light, image, strict=True):
                    add_at(x, one.display, one.weight * r.ravel()[one.view])
        return light


@dataclass(frozen=True, eq=False)
class Looker:
    """A viewer's matrix, the image it should see, and its weight for each colour.

    ideal : (h, w, 3) linear
    weight : (3,)
    """

    matrix: SeenMatrix
    ideal: NDArray[np.float32]
    weight: Floats


class _State(NamedTuple):
    """Light (3, H, W), its errors (3, h, w) as each viewer sees it, and twice f."""

    x: Floats
    errors: tuple[Floats, ...]
    f: float


@dataclass(frozen=True, eq=False)
class Sharpened:
    """The sharpened light of a display (H, W, 3), and its effect.

    n_steps : of the minimisation
    before, after : quality of each viewer's seen image; None if it shows no whole pixel
    """

    light: NDArray[np.float32]
    n_steps: int
    before: tuple[SeenQuality | None, ...]
    after: tuple[SeenQuality | None, ...]

    @property
    def figures(self) -> dict[str, Any] | None:
        """Quality of the first viewer's seen image before and after, as plain data."""
        if self.before[0] is None:
            return None
        return {"before": asdict(self.before[0]), "after": asdict(self.after[0])}


def sharpen(
    lookers: Sequence[Looker],
    light: NDArray[np.float32],
    black: float | Floats,
    held_back: Floats | None = None,
) -> Generator[float, None, Sharpened]:
    """Sharpen the light (H, W, 3) of a display, relative to white; yields progress 0..1.

    Pixels that no viewer sees keep their light.

    black : least light, broadcasts to (H, W, 3)
    held_back : (3, H, W) weight of light past the glass, which should be dark
    """
    start = np.moveaxis(light, 2, 0).astype(float)
    least = np.moveaxis(np.broadcast_to(black, light.shape), 2, 0)
    weights = [one.weight[:, None, None] for one in lookers]
    targets, covers, d = [], [], np.zeros_like(start)
    for one, weight in zip(lookers, weights, strict=True):
        cover = yield from hold_progress(0.0, one.matrix.cover())
        covers.append(cover)
        targets.append(cover * np.moveaxis(one.ideal, 2, 0))
        ones = yield from hold_progress(0.0, one.matrix.seen(np.ones_like(start[:1])))
        d += weight * (yield from hold_progress(0.0, one.matrix.back(ones)))
    if held_back is not None:
        d += held_back
    is_free = d > 0
    scale = np.divide(1.0, d, out=np.zeros_like(d), where=is_free)

    def state_of(x: Floats) -> Steps[_State]:
        errors, f = [], 0.0 if held_back is None else float((held_back * x**2).sum())
        for one, weight, target in zip(lookers, weights, targets, strict=True):
            error = (yield from one.matrix.seen(x)) - target
            errors.append(error)
            f += float((weight * error**2).sum())
        return _State(x, tuple(errors), f)

    def step_from(now: _State, last: _State, beta: float) -> Steps[_State]:
        ahead = now.x + beta * (now.x - last.x)
        gradient = 0.0 if held_back is None else held_back * ahead
        for one, weight, e, before in zip(lookers, weights, now.errors, last.errors, strict=True):
            back = yield from one.matrix.back(e + beta * (e - before))
            gradient = gradient + weight * back
        x = np.where(is_free, (ahead - scale * gradient).clip(least, 1.0), start)
        return (yield from state_of(x))

    x = np.where(is_free, start.clip(least, 1.0), start)
    first = now = last = yield from hold_progress(0.0, state_of(x))
    n_steps, t, progress = 0, 1.0, 0.0
    while n_steps < MOST_STEPS:
        n_steps += 1
        t_next = (1 + (1 + 4 * t * t) ** 0.5) / 2
        tried = yield from hold_progress(progress, step_from(now, last, (t - 1) / t_next))
        if tried.f > now.f and t > 1:  # the momentum overshoots
            t, last = 1.0, now
            continue
        wanted, gain = LEAST_GAIN * first.f, now.f - tried.f
        last, now, t = now, tried, t_next
        if gain <= wanted:
            break
        progress = max(progress, wanted / gain)
    before, after = (_qualities(lookers, one.errors, covers) for one in (first, now))
    yield 1.0
    light = np.ascontiguousarray(np.moveaxis(now.x, 0, 2), np.float32)
    return Sharpened(light, n_steps, before, after)


def _qualities(
    lookers: Sequence[Looker], errors: Sequence[Floats], covers: Sequence[Floats]
) -> tuple[SeenQuality | None, ...]:
    """Quality of each viewer's seen image, whose colours may be apart, with errors (3, h, w)."""
    seen: dict[int, tuple[Floats, Floats, Floats]] = {}
    for one, error, cover in zip(lookers, errors, covers, strict=True):
        error = np.moveaxis(error, 0, 2) * (one.weight > 0)
        _, before, other = seen.get(id(one.ideal), (one.ideal, 0.0, 1.0))
        seen[id(one.ideal)] = one.ideal, before + error, np.minimum(cover, other)
    return tuple(
        quality(ideal + error, ideal, cover > WHOLE) for ideal, error, cover in seen.values()
    )


class Sharpener:
    """Sharpens solutions; caches the last one."""

    def __init__(self) -> None:
        self._last: tuple[object, tuple[PupilViews, ...], str, Sharpened] | None = None

    def sharpened(
        self,
        plans: Sequence[Plan],
        views: tuple[PupilViews, ...],
        past_glass: Sequence[Floats | None],
        light: NDArray[np.float32],
    ) -> Generator[float, None, Sharpened]:
        """Sharpen painted light (H, W, 3), unless neither it nor the views have changed; yields
        progress 0..1.

        plans : of each channel
        past_glass : for each channel the weight (H, W) of light past the glass; None if glare is
            kept
        """
        rig, settings = plans[0].rig, plans[0].settings
        keys = channel_keys(rig, settings)
        black = tuple(one.black_level for one in rig.display.parts)
        of_all = tuple((one.viewer.weight, one.colours) for one in keys)
        asked = fingerprint(black, of_all, settings.suppress_glare)
        last = self._last
        if last is not None and last[0] is light and last[1:3] == (views, asked):
            return last[3]
        for k, one in enumerate(views):
            yield from subprogress(one.trace(), *section((0.0, TRACED), k, len(views)))
        ideals = {v.name: ideal_image(rig.picture_of(v), v) for v in rig.viewers}
        lookers, held_back = [], None
        of_each = zip(keys, views, past_glass, strict=True)
        for key, seen, stray in of_each:
            weight = key.viewer.weight * np.array(key.colours)
            lookers.append(Looker(SeenMatrix(seen), ideals[key.viewer.name], weight))
            if stray is not None:
                stray = settings.suppress_glare * weight[:, None, None] * stray
                held_back = stray if held_back is None else held_back + stray
        steps = sharpen(lookers, light, rig.display.black_in(light), held_back)
        found = yield from subprogress(steps, TRACED, 1.0)
        self._last = light, views, asked, found
        return found
