"""Searches that are traced together: a batch of rays costs as much as thousands of its rays.

A search is a generator that yields places of the viewer's image, and is sent what was found there.
Searches side by side are asked all at once, and their places are traced in one go.
"""

from collections.abc import Generator
from typing import NamedTuple, TypeVar

import numpy as np

from ..base.arrays import Floats
from ..light.plan import Ends, Halving, Plan
from ..light.rays import Words
from .points import Points, trace_points
from .ray_budget import Allowance

T = TypeVar("T")
Asked = TypeVar("Asked")
Told = TypeVar("Told")


class Ask(NamedTuple):
    """Places (n, 2) of the viewer's image, px, and the courses (n, m) that
    their rays keep to; None where these are asked for.

    takes : are the rays taken of the allowance?
    """

    view: Floats
    course: Words | None = None
    takes: bool = True


class Halve(NamedTuple):
    """Edges to be bisected by the kernel; the rays of each start in one pixel.

    takes : as of `Ask`
    """

    edges: Halving
    takes: bool


class Answer(NamedTuple):
    """The points (n,) that were asked for, and their courses (n, m) where these were."""

    points: Points
    course: Words | None = None


Search = Generator[list[Ask | Halve], list[Answer | Ends], T]


def ask(view: Floats, course: Words | None = None, takes: bool = True) -> Search[Answer]:
    """Ask for places (n, 2), as for `Ask`."""
    (answer,) = yield [Ask(view, course, takes)]
    return answer


def side_by_side(
    searches: list[Generator[list[Asked], list[Told], T]],
) -> Generator[list[Asked], list[Told], list[T]]:
    """What searches find that go on together, step by step, until the last has ended."""
    found: list[T | None] = [None] * len(searches)
    answers: list[list[Told] | None] = [None] * len(searches)
    under_way = list(range(len(searches)))

    while True:
        asks: list[list[Asked]] = [[] for _ in searches]
        for k in under_way:
            try:
                asks[k] = searches[k].send(answers[k])
            except StopIteration as end:
                found[k] = end.value
        under_way = [k for k in under_way if asks[k]]
        if not under_way:
            return found

        told = yield [one for k in under_way for one in asks[k]]
        for k in under_way:
            answers[k], told = told[: len(asks[k])], told[len(asks[k]) :]


def traced(
    plan: Plan, search: Search[T], allowance: Allowance | None = None
) -> Generator[int, None, T]:
    """What a search finds, whose rays are taken of an allowance; yields how many
    rays were traced since.
    """
    answers = None
    while True:
        try:
            asks = search.send(answers)
        except StopIteration as end:
            return end.value
        yield 0
        answers = yield from _answers(plan, asks)
        for one, found in zip(asks, answers, strict=True) if allowance is not None else ():
            if not one.takes:
                continue
            if isinstance(one, Halve):
                allowance.take(one.edges.start + one.edges.way / 2, found.n_tried)
            else:
                allowance.take(one.view)


def _answers(plan: Plan, asks: list[Ask | Halve]) -> Generator[int, None, list[Answer | Ends]]:
    """What is found at the places that are asked for, and of the edges."""
    none = Answer(Points.none(), np.empty((0, 1), np.uint64))
    answers: list[Answer | Ends] = [none] * len(asks)
    for k, one in enumerate(asks):
        if isinstance(one, Halve):
            answers[k] = yield from plan.tracer.bisect(plan, one.edges)

    places = [(k, one) for k, one in enumerate(asks) if isinstance(one, Ask) and len(one.view)]
    for is_open in (False, True):
        some = [k for k, one in places if (one.course is None) == is_open]
        if not some:
            continue

        view = np.concatenate([asks[k].view for k in some])
        if is_open:
            courses: list[Words] = []
            points = yield from trace_points(plan, view, courses=courses)
            course = _together(courses)
        else:
            course = _together([asks[k].course for k in some])
            points = yield from trace_points(plan, view, course)

        first = 0
        for k in some:
            part = np.arange(first, first + len(asks[k].view))
            answers[k] = Answer(points.at(part), course[part] if is_open else None)
            first += len(part)

    return answers


def _together(courses: list[Words]) -> Words:
    """Courses (n, m), of several widths m, one after the other."""
    widths = {course.shape[1] for course in courses}
    width = max(widths)
    if len(widths) == 1:
        return np.concatenate(courses)
    return np.concatenate(
        [np.pad(course, ((0, 0), (0, width - course.shape[1]))) for course in courses]
    )
