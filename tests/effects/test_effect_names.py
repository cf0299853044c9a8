"""No effect is named outside of the catalogue: whoever treats one apart asks for what stands in the catalogue.

The virtual bench and the simulator of flights are independent of the catalogue and have names of their own.
"""

import io
import re
import tokenize
from pathlib import Path

import pytest

from shockrig.analysis.effects import CATALOGUE

ROOT = Path(__file__).parents[2]
PLACES = ("files", "analysis", "protocols", "shockrig")
# The laws of flights are a catalogue of their own, which says by what each would come.
EXEMPT = ("analysis/effects/", "analysis/learn/laws.py", "analysis/flight/simulated/sensor.py")
NAMES = re.compile(r"\b(" + "|".join(map(re.escape, CATALOGUE)) + r")\b")
# Words of the field's own, which prose may use; with an underscore in it a word is an id.
PROSE = {name for name in CATALOGUE if "_" not in name}
# A behaviour that shock-diagnosis/1 describes without naming a cause has the same words.
OTHER_MEANING = {
    (place, "parallel_lag")
    for place in ("files/diagnosis_data.py", "analysis/diagnose/grammar.py", "analysis/report/diagnosis_words.py")
}


def named(text):
    """(line, id) of every effect that a program names, in strings or names; prose may use one of its words."""
    kinds = {tokenize.NAME, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING)}
    found = []
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in kinds:
            alone = token.string.strip("rbfu'\"")
            names = NAMES.findall(token.string)
            found += [(token.start[0], name) for name in names if name not in PROSE or name == alone]
    return found


SOURCES = sorted(
    file.relative_to(ROOT).as_posix()
    for place in PLACES
    for file in (ROOT / place).rglob("*.py")
    if not file.relative_to(ROOT).as_posix().startswith(EXEMPT)
)


@pytest.mark.parametrize("source", SOURCES)
def test_no_effect_is_named(source):
    found = named((ROOT / source).read_text(encoding="utf-8"))
    found = [(line, name) for line, name in found if (source, name) not in OTHER_MEANING]
    assert not found, f"{source} names {found}: ask the catalogue for what is peculiar to it"


def test_names_are_found_as_whole_words_in_strings_and_in_names():
    assert named('a\nif effect == "dead_time":') == [(2, "dead_time")]
    assert named("from x import hysteresis") == [(1, "hysteresis")]
    assert named("dead_times, undead_time, stem_conduction_of") == []
    assert named('f("calibration and hysteresis: 6 %RH")  # dead_time') == []
    assert named('"""What the dead_time does."""') == [(1, "dead_time")]
    assert len(SOURCES) > 100
