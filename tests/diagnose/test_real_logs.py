"""Logs that other people recorded, against what their authors published and what cannot be known from them."""

import re
from pathlib import Path

import pytest

from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.seen import seen
from shockrig.analysis.report.next_time import seen_sentence
from shockrig.files.campaign import read_campaign
from shockrig.files.errors import InputError
from shockrig.protocols.cli import main

REAL = Path(__file__).parents[2] / "data" / "real"
PUBLISHED_T63_S = {"control": 217.0, "open": 124.0, "closed": 381.0}


@pytest.fixture(scope="module")
def haar(tmp_path_factory):
    out = tmp_path_factory.mktemp("real") / "haar"
    logs = [str(REAL / "haar" / name) for name in ("Temperature.csv", "Humidity.csv")]
    assert main(["import", *logs, "--map", "haar", "--out", str(out)]) == 0
    return out


def test_the_published_times_are_found(haar, capsys):
    logs = [str(REAL / "haar" / "Temperature.csv")]
    assert main(["import", *logs, "--map", "haar", "--out", str(haar.parent / "again")]) == 0
    printed = dict(re.findall(r"(\w+)\.temperature: .* 63 % after ([\d.]+) s", capsys.readouterr().out))
    for housing, seconds in PUBLISHED_T63_S.items():
        assert float(printed[housing]) == pytest.approx(seconds, rel=0.08)


@pytest.mark.parametrize("housing", ["control", "open"])
def test_the_report_says_them_by_no_model(haar, housing):
    (one,) = seen(build_channel(read_campaign(haar / housing), "temperature"))
    assert one.times_s[0] == pytest.approx(PUBLISHED_T63_S[housing], rel=0.05)


def test_the_closed_housing_lags_less_behind_the_air_than_its_curve_takes(haar):
    channel = build_channel(read_campaign(haar / "closed"), "temperature")
    lags = {one.run: one.behind_s for one in seen(channel)}
    assert 190.0 < lags["0001"] < 250.0


def test_a_plunge_between_two_readings_has_a_bound_alone(tmp_path):
    log = next((REAL / "rbr").glob("*.csv"))
    assert main(["import", str(log), "--map", "rbr", "--out", str(tmp_path / "rbr")]) == 0
    campaign = read_campaign(tmp_path / "rbr" / "first")
    assert "63 % of the way within 2.00 s" in seen_sentence(build_channel(campaign, "temperature"))
    with pytest.raises(InputError, match="run shockrig diagnose, which tries other bodies"):
        characterize(campaign)
