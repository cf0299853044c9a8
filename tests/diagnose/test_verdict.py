"""The verdict as a table: what was found and what is left, and what is said."""

from dataclasses import replace

import pytest
from foreign_lab import Arrival, Lab, LabLogger, LabRun, Written, make_body, record

from shockrig.analysis.diagnose.diagnose import diagnose_channel
from shockrig.analysis.diagnose.diagnosed import ChannelOutcome, Near, read_outcome
from shockrig.analysis.diagnose.verdict import Standing, verdict
from shockrig.analysis.estimate.channel import LeftOut
from shockrig.analysis.estimate.gather import UNSETTLED, build_channel
from shockrig.files.campaign import read_campaign


@pytest.mark.parametrize(
    ("standing", "said"),
    [
        # Nothing is left that matters.
        (Standing(), "adequate"),
        (Standing(named=1), "explained"),
        (Standing(forms=1), "described"),
        (Standing(named=2, forms=1), "described"),
        (Standing(shown=1), "described"),
        (Standing(named=1, shown=1), "described"),
        # What is left and matters.
        (Standing(left_over=True), "unexplained"),
        (Standing(named=1, left_over=True), "unexplained"),
        (Standing(forms=1, left_over=True), "unexplained"),
        (Standing(shown=1, left_over=True), "unexplained"),
        # The input says that the runs fall into groups.
        (Standing(parted=True), "unexplained"),
        (Standing(named=2, parted=True), "unexplained"),
        (Standing(shown=1, parted=True), "unexplained"),
        (Standing(forms=1, parted=True), "described"),
        (Standing(forms=1, parted=True, left_over=True), "unexplained"),
        # Most runs were left out since the readings did not stand still.
        (Standing(unsettled=True), "unexplained"),
        (Standing(named=1, unsettled=True), "explained"),
        (Standing(shown=1, unsettled=True), "described"),
        # Another model is likelier than the plain one, and nothing sure enough to be stated.
        (Standing(left_open=True), "unexplained"),
        (Standing(shown=1, left_open=True), "described"),
        # One run: a shape that no other run has borne out explains nothing; nothing to explain is adequate.
        (Standing(named=1, borne_out=False, claims=False), "unexplained"),
        (Standing(named=1, borne_out=False), "explained"),
        (Standing(borne_out=False, claims=False), "adequate"),
        (Standing(named=1, claims=False), "explained"),
    ],
)
def test_a_verdict_is_a_function_of_where_a_channel_stands(standing, said):
    assert verdict(standing) == said


def test_runs_that_are_good_speak_for_no_sensor_that_is_restless_in_most(tmp_path):
    plan = tuple(LabRun(*((60.0, 20.0) if i % 2 else (20.0, 60.0)), start_s=3.0, length_s=9.0) for i in range(4))
    written = Written(body="lumped")
    lab = Lab("temperature", make_body("lumped", 0.6), Arrival(), LabLogger(0.05, 0.01, 0.03), plan, written)
    record(lab, 5, tmp_path / "lab")
    channel = build_channel(read_campaign(tmp_path / "lab"), "temperature")

    def told_beside(drifting):
        left_out = tuple(LeftOut(f"1{i:03}", "temperature", f"{UNSETTLED}: it drifts") for i in range(drifting))
        return diagnose_channel(replace(channel, left_out=left_out), describing=False)

    few, most = told_beside(4), told_beside(5)
    assert few.verdict == "adequate" and not any("settled" in said for said in few.cannot_tell)
    assert most.verdict == "unexplained" and most.cannot_tell[-1].startswith("In 5 of 9 runs")


@pytest.mark.parametrize("key", ["runs", "passed", "weight", "best", "stated", "near", "explanation", "tied", "lacks"])
def test_what_a_file_does_not_say_of_a_diagnosis_is_not_made_up(key):
    """Before: without `passed` it had not passed, and without `lacks` no model lacked anything."""
    near = {"explanation": {}, "nats": 0.0, "tied": True, "lacks": False}
    said = {"runs": ["1"], "passed": True, "weight": 1.0, "best": {}, "stated": {}, "near": [near]}
    whole = read_outcome("adequate", said, "temperature")
    assert whole == ChannelOutcome("adequate", ("1",), True, 1.0, {}, {}, (Near({}, 0.0, True, False),))
    for one in (said, near):
        one.pop(key, None)
    assert read_outcome("adequate", said, "temperature") is None
