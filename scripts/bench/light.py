"""Direction, pupil and colour of light, judged: `dev.py light`.

Each row names a quantity, the number found, and whether it keeps its mark. `light_views.py`,
`light_pupil.py` and `light_colour.py` have the cases.
"""

from __future__ import annotations

from . import light_colour, light_pupil, light_views
from .runner import Bench, run

CASES = light_views.CASES | light_pupil.CASES | light_colour.CASES
BENCH = Bench(
    CASES,
    {"what": "", "found": "", "kept": ""},
    lambda _name, rows, _options: rows(),
    is_apart=True,
)

if __name__ == "__main__":
    run(__doc__, "bench.light", BENCH)
