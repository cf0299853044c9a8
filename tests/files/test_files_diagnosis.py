"""The diagnosis's file: what is written is read back, keeps to its schema, and every fault is named by its key."""

import json
import math
from importlib import resources

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shockrig.files.diagnosis import (
    Dependence,
    Discovered,
    EffectSize,
    Likeness,
    StatedCause,
    StatedChannel,
    StatedDiagnosis,
    StatedGain,
    StatedRemainder,
    Uncertain,
    diagnosis_document,
    diagnosis_from_document,
    read_diagnosis,
    write_diagnosis,
)
from shockrig.files.diagnosis_data import BEHAVIOURS, DRIVERS, FACTORS
from shockrig.files.errors import InputError

SCHEMA = json.loads((resources.files("shockrig.data") / "schemas" / "shock-diagnosis-1.json").read_text())
KEPT = jsonschema.Draft202012Validator(SCHEMA)

# As the format's page has it, with all that a channel may say.
PAGE = {
    "format": "shock-diagnosis/1",
    "campaign": "spring",
    "channels": {
        "temperature": {
            "verdict": "explained",
            "causes": [
                {
                    "effect": "stem_conduction",
                    "probability": 0.99,
                    "parameters": {
                        "fraction": {"value": 0.03, "standard_uncertainty": 0.001},
                        "time_constant_s": {"value": 8.1, "standard_uncertainty": 0.2},
                    },
                    "indistinguishable_from": ["air_relaxation"],
                    "at_bound": ["fraction"],
                    "evidence": "the misfit falls by 912",
                }
            ],
            "discovered": [],
            "gain": {
                "held_out_rmse_before": 0.21,
                "held_out_rmse_after": 0.021,
                "noise_floor": 0.020,
                "explained_fraction": 0.99,
                "interval_95": [0.98, 1.0],
            },
            "remainder": {
                "rms": 0.018,
                "peak": 0.14,
                "unit": "K",
                "significant": True,
                "material": False,
                "tolerance": 0.2,
                "from_s": 0.15,
                "until_s": 0.6,
                "varies_with": ["airflow"],
            },
            "untestable": ["clock_drift"],
        },
        "humidity": {
            "verdict": "described",
            "causes": [],
            "discovered": [
                {
                    "behaves_as": "lag_in_series",
                    "driver": "air_humidity",
                    "time_constant_s": {"value": 1.4, "standard_uncertainty": 0.1},
                    "size": {"value": 1.0, "standard_uncertainty": 0.02, "unit": "1"},
                    "depends_on": [{"factor": "airflow", "form": "power", "value": -0.5, "standard_uncertainty": 0.1}],
                    "does_not_depend_on": ["direction", "ambient"],
                    "alternatives": [],
                    "nearest_catalogued": {
                        "effect": "vapour_boundary_layer",
                        "likeness": 0.93,
                        "why_not": "does not change with the airflow",
                    },
                    "probability": 0.97,
                    "explained_fraction": 0.96,
                    "seen_over": {"airflow_m_s": [2.5, 12.0], "ambient_temperature_c": [0.0, 40.0]},
                }
            ],
        },
    },
    "next_experiments": [{"source": {"temperature_c": 20.0}, "destination": {"temperature_c": 0.0}}],
    "made_by": "hand",
}


def changed(**changes):
    """A copy of PAGE with `a__b` -> value."""
    document = json.loads(json.dumps(PAGE))
    for key, value in changes.items():
        *parents, last = key.split("__")
        place = document["channels"] if parents else document
        for parent in parents:
            place = place[int(parent) if parent.isdigit() else parent]
        place[int(last) if last.isdigit() else last] = value
    return document


def test_the_formats_own_example_is_read_and_written_alike(tmp_path):
    jsonschema.validate(PAGE, SCHEMA)
    found = diagnosis_from_document(PAGE)
    temperature, humidity = found.channels["temperature"], found.channels["humidity"]
    (cause,) = temperature.causes
    assert (cause.effect, cause.value("time_constant_s"), cause.at_bound) == ("stem_conduction", 8.1, ("fraction",))
    assert temperature.gain.interval_95 == (0.98, 1.0)
    assert temperature.remainder == StatedRemainder(0.018, 0.14, "K", True, False, 0.2, 0.15, 0.6, ("airflow",))
    assert temperature.extra == {"untestable": ["clock_drift"]} and found.extra == {"made_by": "hand"}
    (unlisted,) = humidity.discovered
    assert unlisted.time_constant_s == Uncertain(1.4, 0.1) and unlisted.size == EffectSize(1.0, 0.02, "1")
    assert unlisted.depends_on == (Dependence("airflow", "power", -0.5, 0.1),)
    assert unlisted.nearest_catalogued.likeness == 0.93 and unlisted.seen_over["airflow_m_s"] == (2.5, 12.0)
    assert humidity.gain is None and humidity.remainder is None
    write_diagnosis(found, tmp_path / "d.json")
    assert json.loads((tmp_path / "d.json").read_text()) == PAGE
    assert read_diagnosis(tmp_path / "d.json") == found


digits = st.floats(-1e6, 1e6).map(lambda x: float(f"{x:.7g}"))
sizes = digits.map(abs)
words = st.text("abcdefgh_", min_size=1, max_size=8)
many = st.lists(words, max_size=3).map(tuple)
uncertain = st.builds(Uncertain, digits, sizes)
shares = st.floats(0, 1).map(lambda x: float(f"{x:.7g}"))
intervals = st.tuples(digits, digits).map(lambda ends: tuple(sorted(ends)))
maybe = lambda strategy: st.none() | strategy  # noqa: E731
causes = st.builds(StatedCause, words, st.dictionaries(words, uncertain, max_size=3), shares, many, many, words)
alone = dict(
    behaves_as=st.sampled_from(BEHAVIOURS),
    driver=st.sampled_from(DRIVERS),
    time_constant_s=maybe(uncertain),
    period_s=maybe(uncertain),
    size=maybe(st.builds(EffectSize, digits, sizes, words)),
    depends_on=st.lists(
        st.builds(Dependence, st.sampled_from(FACTORS), words, maybe(digits), maybe(sizes)), max_size=2
    ).map(tuple),
    does_not_depend_on=many,
    nearest_catalogued=maybe(st.builds(Likeness, words, shares, words)),
    probability=maybe(shares),
    explained_fraction=maybe(digits),
    seen_over=st.dictionaries(words, intervals, max_size=2),
)
discovered = st.builds(
    Discovered, **alone, alternatives=st.lists(st.builds(Discovered, **alone), max_size=2).map(tuple)
)
gains = st.builds(StatedGain, maybe(sizes), maybe(sizes), maybe(sizes), maybe(digits), maybe(intervals))
remainders = st.builds(
    StatedRemainder, sizes, sizes, words, st.booleans(), st.booleans(), sizes, maybe(digits), maybe(digits), many
)
some = lambda strategy: st.lists(strategy, min_size=1, max_size=3).map(tuple)  # noqa: E731
rest = dict(gain=maybe(gains), remainder=maybe(remainders))
channels = (
    st.builds(StatedChannel, st.just("adequate"), **rest)
    | st.builds(StatedChannel, st.just("explained"), some(causes), **rest)
    | st.builds(StatedChannel, st.just("described"), st.just(()) | some(causes), some(discovered), **rest)
    | st.builds(
        StatedChannel,
        st.just("unexplained"),
        st.just(()) | some(causes),
        **rest,
        discrepancy=maybe(st.just({"p": 0.5})),
    )
)
diagnoses = st.builds(
    StatedDiagnosis, words, st.dictionaries(st.sampled_from(("temperature", "humidity")), channels, min_size=1)
)


@settings(max_examples=100, deadline=None)
@given(diagnoses)
def test_whatever_is_written_keeps_to_the_schema_and_is_read_back(diagnosis):
    document = json.loads(json.dumps(diagnosis_document(diagnosis), allow_nan=False))
    KEPT.validate(document)
    assert diagnosis_from_document(document) == diagnosis


def test_what_is_not_finite_is_left_out_and_numbers_have_seven_digits():
    nan = math.nan
    cause = StatedCause("dead_time", {"delay_s": Uncertain(np.float64(1 / 3), nan), "x": Uncertain(nan, 0.1)}, 0.5)
    gain = StatedGain(0.1, nan, None, -math.inf, (nan, 1.0))
    channel = StatedChannel(
        "explained", (cause,), gain=gain, extra={"matrix": np.array([[1.0, 2.0], [nan, 1.0]]), "n": np.int64(3)}
    )
    document = diagnosis_document(StatedDiagnosis("x", {"temperature": channel}))
    json.dumps(document, allow_nan=False)
    content = document["channels"]["temperature"]
    assert content["causes"][0]["parameters"] == {"delay_s": {"value": 0.3333333}}
    assert content["gain"] == {"held_out_rmse_before": 0.1}
    assert content["matrix"] == [[1.0, 2.0], None] and content["n"] == 3


@pytest.mark.parametrize(
    "channel",
    [
        StatedChannel("adequate", (StatedCause("dead_time"),)),
        StatedChannel("explained"),
        StatedChannel("described", (StatedCause("dead_time"),)),
        StatedChannel("certain"),
        StatedChannel(None),
    ],
)
def test_a_verdict_that_contradicts_its_causes_is_not_written(tmp_path, channel):
    with pytest.raises(ValueError, match="channels.humidity: verdict"):
        write_diagnosis(StatedDiagnosis("x", {"humidity": channel}), tmp_path / "d.json")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"format": "sensor-profile/1"}, "key format"),
        ({"channels": []}, "key channels: expected an object, found a list"),
        ({"channels": {}}, "key channels: holds neither temperature nor humidity"),
        ({"channels": {"pressure": {}}}, "key channels: holds neither"),
        ({"channels": {"humidity": 5}}, "key channels.humidity: expected an object, found 5"),
        ({"temperature__verdict": "perfect"}, "key channels.temperature.verdict: expected one of adequate,"),
        ({"temperature__verdict": 1}, "key channels.temperature.verdict: expected text, found 1"),
        ({"temperature__causes": {}}, "key channels.temperature.causes: expected a list, found an object"),
        ({"temperature__causes__0": "stem"}, "key channels.temperature.causes[0]: expected an object"),
        ({"temperature__causes__0__effect": None}, "key channels.temperature.causes[0].effect: expected the id"),
        ({"temperature__causes__0__probability": 1.5}, "causes[0].probability: 1.5 cannot be; expected 0 to 1"),
        ({"temperature__causes__0__parameters": [1]}, "causes[0].parameters: expected an object, found a list"),
        (
            {"temperature__causes__0__parameters__fraction__value": "much"},
            "causes[0].parameters.fraction.value: expected a finite number, found 'much'",
        ),
        (
            {"temperature__causes__0__parameters__fraction__standard_uncertainty": -1},
            "causes[0].parameters.fraction.standard_uncertainty: expected a finite number of at least 0, found -1",
        ),
        ({"temperature__causes__0__indistinguishable_from": [1]}, "causes[0].indistinguishable_from: expected a list"),
        ({"temperature__gain__held_out_rmse_after": -1}, "gain.held_out_rmse_after"),
        ({"temperature__gain__interval_95": [1.0]}, "gain.interval_95: expected two numbers"),
        ({"temperature__gain__interval_95": [1.0, 0.5]}, "gain.interval_95: expected two numbers, the lower one first"),
        ({"temperature__remainder__material": "no"}, "remainder.material: expected true or false, found 'no'"),
        ({"temperature__remainder__rms": None}, "remainder.rms: expected a number, found nothing"),
        ({"humidity__discovered__0__behaves_as": "magic"}, "discovered[0].behaves_as: expected one of lag_in_series"),
        ({"humidity__discovered__0__driver": None}, "discovered[0].driver: expected one of air_temperature"),
        ({"humidity__discovered__0__depends_on__0__factor": "moon"}, "discovered[0].depends_on[0].factor"),
        ({"humidity__discovered__0__alternatives": [{}]}, "discovered[0].alternatives[0].behaves_as"),
        ({"humidity__discovered__0__seen_over": {"airflow_m_s": 5}}, "discovered[0].seen_over.airflow_m_s"),
        ({"next_experiments": [1]}, "key next_experiments[0]: expected an object, found 1"),
    ],
)
def test_errors_name_file_key_and_remedy(tmp_path, changes, named):
    (tmp_path / "d.json").write_text(json.dumps(changed(**changes)))
    with pytest.raises(InputError) as raised:
        read_diagnosis(tmp_path / "d.json")
    message = str(raised.value)
    assert message.startswith(f"{tmp_path / 'd.json'}: ") and named in message and "\n" not in message
    assert message.endswith("; give the diagnosis.json of shockrig diagnose")


def test_what_is_unknown_may_be_left_out_or_null():
    minimal = {"format": "shock-diagnosis/1", "channels": {"humidity": {"causes": [{"effect": "hysteresis"}]}}}
    (cause,) = diagnosis_from_document(minimal).channels["humidity"].causes
    assert cause == StatedCause("hysteresis")
    nulls = changed(
        temperature__gain=None, temperature__remainder=None, humidity__discovered=None, next_experiments=None
    )
    found = diagnosis_from_document(nulls)
    assert found.channels["temperature"].gain is None and found.next_experiments == ()
    bare = changed(temperature__causes__0__parameters={"fraction": 0.03, "time_constant_s": None})
    (cause,) = diagnosis_from_document(bare).channels["temperature"].causes
    assert cause.parameters == {"fraction": Uncertain(0.03, 0.0)}


CATALOGUE = {"stem_conduction": ("temperature",), "hysteresis": ("temperature", "humidity")}


@pytest.mark.parametrize(
    ("cause", "named"),
    [
        ({"effect": "magic"}, "causes[0].effect: 'magic' is not in the catalogue (stem_conduction, hysteresis)"),
        ({"effect": "stem_conduction"}, "causes[0].effect: stem_conduction does not act on the humidity channel"),
        ({"effect": "hysteresis", "parameters": {"rh_percent": {}}}, "causes[0].parameters.rh_percent: expected"),
        ({"effect": "hysteresis", "parameters": {"rh_percent": None}}, "causes[0].parameters.rh_percent: expected"),
    ],
)
def test_those_who_mean_to_fit_the_causes_are_told_what_they_cannot_fit(cause, named):
    document = {"format": "shock-diagnosis/1", "channels": {"humidity": {"causes": [cause]}}}
    assert diagnosis_from_document(document).channels["humidity"].causes[0].effect == cause["effect"]
    with pytest.raises(InputError) as raised:
        diagnosis_from_document(document, "d.json", CATALOGUE)
    assert named in str(raised.value)
