"""The page of flights that were learned from says what was found, what is open and what was left out, in words."""

import re
from dataclasses import replace

import numpy as np
import pytest

from shockrig.analysis.learn.bins import SUB_SAMPLES, FlightBins, passes
from shockrig.analysis.learn.flights_fit import Learned, known_of
from shockrig.analysis.learn.laws import LAWS
from shockrig.analysis.learn.learn import ChannelLearned, FlightCause, FlightsLearned, LearnedNumber
from shockrig.analysis.learn.passes import Disagreement
from shockrig.analysis.report.learned_page import verdict, write_learned_page


def flown(name):
    """Up to 300 m at 3 m/s and down at 6 m/s, with both channels."""
    time_s = np.arange(0.5, 150.0, 1.0)
    track = np.interp(time_s, [0.0, 100.0, 150.0], [0.0, 300.0, 0.0])
    values = {"temperature": 15.0 - 0.0065 * track, "humidity": 50.0 + 0.02 * track}
    still = np.ones(time_s.size)
    return FlightBins(
        name, time_s, still, np.repeat(time_s[:, None], SUB_SAMPLES, axis=1), time_s, track, track,
        time_s, np.gradient(track), np.full(time_s.size, np.nan), values, passes(track, time_s),
    )  # fmt: skip


def fit(key, *theta):
    laws = (LAWS[key],)
    p, units = len(theta), 2
    information = np.tile(50.0 * np.eye(p), (units, 1, 1))
    return Learned(laws, known_of(laws), np.array(theta), (), np.zeros(units), np.zeros((units, p)), information)


def apart(size, names=("one", "two")):
    altitude = np.linspace(50.0, 250.0, 5)
    flights = tuple(name for name in names for _ in altitude)
    return Disagreement(flights, np.tile(altitude, len(names)), np.full(5 * len(names), size))


def channel(name, said, causes=(), why="", model=0.1, names=("one", "two")):
    lag = fit(f"{name}.lag", np.log(5.0))
    off = [apart(size, names) for size in (0.6, 0.2, model)]
    return ChannelLearned(name, said, causes, (), (), 9.0, why, lag, lag, *off)


LAG = FlightCause(LAWS["temperature.lag"], 0.991, (LearnedNumber(LAWS["temperature.lag"].parameters[0], 5.0, 0.3),))
WASHED = LAWS["temperature.offset_in_descent"]
WASH = FlightCause(WASHED, 0.98, (LearnedNumber(WASHED.parameters[0], -1.0, 0.1),))
BOTH = replace(fit("temperature.lag", np.log(5.0)), laws=(LAWS["temperature.lag"], WASHED))
OFFSET = LAWS["humidity.offset_in_descent"]
DESCENT = FlightCause(OFFSET, 0.98, (LearnedNumber(OFFSET.parameters[0], -2.0, 0.4),))
SHIFT = LAWS["position.clock_offset"]
CLOCK = FlightCause(SHIFT, 0.97, (LearnedNumber(SHIFT.parameters[0], 18.0, 0.4),))


@pytest.fixture
def learned():
    weights = (("temperature.lag + humidity.offset_in_descent", 0.97), ("nothing", 0.03))
    channels = {"temperature": channel("temperature", "named", (LAG,)),
                "humidity": channel("humidity", "tied", (DESCENT,))}  # fmt: skip
    return FlightsLearned(
        (flown("one"), flown("two")), {"hover.csv": "it passes no air twice"}, channels, (), False, weights
    )


def test_the_page_says_what_acts_what_is_open_and_what_was_left_out(learned, tmp_path):
    page = write_learned_page(learned, tmp_path / "learned.html", ["one.csv", "two.csv"], ["climb at 2 m/s by night"])
    text = page.read_text()
    assert "The thermometer has a lag (time constant 5.00 ± 0.30 s)." in text
    assert "the rotors&#x27; wash, the carrier&#x27;s wake or hysteresis of the film: flights alone cannot tell" in text
    assert "0.60 → 0.10 K" in text and "up 3.0; down 5.9" in text
    assert "it passes no air twice" in text and "Climb at 2 m/s by night." in text and "97.0 %" in text
    assert text.count("<img") == 2
    words = re.sub(r"<style>.*?</style>|<[^>]*>", " ", text, flags=re.DOTALL)
    assert not re.search(r"[a-z]_[a-z]", words)  # labels are words


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"verdict": "adequate", "causes": ()}, "The thermometer is adequate"),
        (
            {"verdict": "tied", "causes": (replace(LAG, probability=0.8), replace(WASH, probability=0.7)), "fit": BOTH},
            "may have a lag (probability 0.80) and an offset in descent (probability 0.70); these flights",
        ),
        (
            {"verdict": "tied", "causes": (replace(LAG, probability=0.8), replace(WASH, probability=0.7))},
            "may have a lag (probability 0.80) or an offset in descent (probability 0.70); these flights",
        ),
        ({"verdict": "not identifiable", "why": "all passes have one speed"}, "these flights: all passes have one"),
        ({"verdict": "tied", "causes": (replace(LAG, probability=0.6),)}, "may have a lag (probability 0.60); these"),
        (
            {"causes": (replace(LAG, probability=0.6), FlightCause(LAWS["temperature.second_path"], 0.38, ()))},
            "lags by a lag (probability 0.60) or a slow second path (probability 0.38); these flights do not settle",
        ),
        ({"model": apart(0.7)}, "correcting the temperature makes passes disagree more than the readings do"),
    ],
)  # fmt: skip
def test_each_verdict_is_a_sentence_and_a_correction_that_does_harm_is_told(learned, changed, expected):
    channels = {**learned.channels, "temperature": replace(learned.channels["temperature"], **changed)}
    assert expected in verdict(replace(learned, channels=channels))


def test_a_clock_is_told_by_its_side(learned):
    assert "The altitude is 18.00 ± 0.40 s behind" in verdict(replace(learned, position=(CLOCK,), position_named=True))


def test_one_flight_alone_judges_no_correction(learned, tmp_path):
    alone = {"temperature": channel("temperature", "named", (LAG,), model=0.9, names=("one",))}
    page = write_learned_page(replace(learned, bins=learned.bins[:1], channels=alone), tmp_path / "p.html", ["one.csv"])
    text = page.read_text()
    assert "None is left to judge a correction by" in text and "makes passes disagree more" not in text
