"""Whether a compiled part is of the source that lies beside it: one that was built before a change would be used in
silence, and its numbers are others.

Each source says what it is, `#define SOURCE "..."`: the beginning of the SHA-256 of its other lines, to which
tests/test_house.py holds it. What is built from it has that as its docstring.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from types import ModuleType


def demand_current(part: ModuleType) -> None:
    """Raise ImportError, and warn, where the compiled part `_x` was built from another x.c than lies beside it; one
    without a source is taken as it is."""
    built = Path(str(part.__file__))
    source = built.with_name(f"{part.__name__.rpartition('._')[2]}.c")
    if source.is_file() and f'#define SOURCE "{part.__doc__}"' not in source.read_text(encoding="utf-8"):
        said = (
            f"{built.name} was built from another {source.name} than {source} and is not used, so that work takes "
            "longer; build it once more: pip install -e ."
        )
        warnings.warn(said, RuntimeWarning, stacklevel=1)
        raise ImportError(said)
