"""A job that makes an atlas: a plan, places of the head as tasks, and a join that checks.

How many places there are is known when the atlas is planned, and planning is a task. So the other
tasks are shares, one place in so many, whatever their number is. Where the places miss the
tolerance a step halves the grid, and as many shares make the new places. The join does what is left
over by itself. All that tasks know of each other is the index in their folder: each may be run
again.
"""

from dataclasses import dataclass
from typing import Any

from ...base.errors import RigError
from .job import MOST, files, refuse_braces, step, whole

SHARES = 10  # tasks
ROUNDS = 2  # of shares: a grid of the first keeps its tolerance nearly always


@dataclass(frozen=True)
class AtlasJob:
    """The atlas that is wanted.

    blend : name of the file in the bundle
    version : Kiriko's
    options : of the verb atlas, which say what atlas it is
    shares : tasks that share the places
    overwrite : may the plan replace the atlas of another rig or box?
    """

    name: str
    blend: str
    version: str
    options: tuple[str, ...]
    shares: int = SHARES
    overwrite: bool = False

    def check(self) -> None:
        """Raise RigError where no scheduler would take such a job."""
        if not 1 <= self.shares <= MOST:
            raise RigError(
                "{n} tasks cannot share the places of the head: set 1 to {most}.",
                n=self.shares,
                most=MOST,
            )
        refuse_braces(self.name, self.blend)

    @property
    def template(self) -> dict[str, Any]:
        """Its template."""
        share = {"name": "Share", "type": "INT", "range": "1-{{Param.Shares}}"}
        space = {"taskParameterDefinitions": [share]}
        steps = [self._step("Plan", "--plan", *(["--overwrite"] if self.overwrite else []))]

        def add(name: str, *how: str, space: dict[str, Any] | None = None) -> None:
            steps.append(self._step(name, *how, after=steps[-1]["name"], space=space))

        for n in range(1, ROUNDS + 1):
            if n > 1:
                add(f"Halve {n - 1}", "--halve")
            add(f"Places {n}", "--share={{Task.Param.Share}}/{{Param.Shares}}", space=space)
        add("Join")

        shares = {
            "name": "Shares",
            "type": "INT",
            "default": self.shares,
            "minValue": 1,
            "maxValue": MOST,
            "description": "Tasks that share the places of the head",
        }
        return whole(self.name, [*files(self.blend), shares], steps)

    def _step(
        self, name: str, *how: str, after: str | None = None, space: dict[str, Any] | None = None
    ) -> dict[str, Any]:
        verb = ["atlas", *self.options, *how, "--out", "{{Param.OutDir}}"]
        return step(name, self.version, verb, after, space)
