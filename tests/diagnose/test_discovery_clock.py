"""A clock that runs fast is late by a share of the time that a run has lasted, a delay is not: told apart where the
plateaus before the transfers differ, by name and, where no name is listed, as a delay that grows."""

import numpy as np
import pytest
from small_worlds import record

from shockrig.analysis.diagnose.diagnose import diagnose_channel
from shockrig.analysis.diagnose.remainder import Tolerance
from shockrig.analysis.effects.described import described, discovered_of
from shockrig.analysis.effects.jumps import when_it_jumps_s
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import Model, Point, Structure
from shockrig.analysis.report.diagnosis_words import flies, sentence
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import ROUGH, Hidden

PPM = 9000.0
pytestmark = pytest.mark.usefixtures("catalogue_as_it_was")


@pytest.fixture(scope="module")
def fast(tmp_path_factory):
    """Both channels of a world in which both clocks run fast."""
    hidden = [Hidden("clock_drift", {"ppm": PPM}, ("temperature", "humidity"))]
    campaign = record(tmp_path_factory.mktemp("fast") / "campaign", 13, hidden, ROUGH, standard_plan())
    return {name: build_channel(campaign, name) for name in ("temperature", "humidity")}


@pytest.mark.trial
def test_the_standard_campaign_tells_a_clock_from_a_delay(fast):
    found = diagnose_channel(fast["temperature"], tolerance=Tolerance(0.0, 0.0))
    (cause,) = found.causes
    # Three runs of 36 tell the two apart: drawn again, one set in twenty has none of them.
    assert cause.effect == "clock_drift" and cause.probability > 0.85
    assert set(cause.indistinguishable_from) <= {"dead_time"}
    told = cause.parameters["ppm"]
    assert abs(told.value - PPM) < 3.0 * told.standard_uncertainty < 0.2 * PPM
    assert found.verdict == "explained"


def test_a_clock_that_the_catalogue_has_not_is_described_as_a_delay_that_grows():
    """That it is found so is seen by benchmarks/fixed_trials.py."""
    one = discovered_of(described("delay|none|history:linear", False), {"size": (PPM, 100.0)})
    assert (one.behaves_as, [on.factor for on in one.depends_on]) == ("delay", ["history"])
    assert (one.size.value, one.size.unit) == (PPM, "1e-6")
    assert "parts per million" in sentence(one, "K") and "how long the run has lasted" in sentence(one, "K")
    assert "no part in a flight" in flies(one, "temperature")


def test_jumps_tell_the_share_by_which_each_is_late(fast):
    """Transfers come 10 and 30 s after a run's first reading: jumps are late by 0.09 and 0.27 s."""
    channel = fast["humidity"]
    share = when_it_jumps_s(channel, channel.conditions.start_s)
    assert share == pytest.approx(1e-6 * PPM, abs=2.5e-3)
    assert when_it_jumps_s(fast["temperature"], channel.conditions.start_s) is None


@pytest.mark.parametrize(
    ("key", "unit"), [("delay|none|run_order:linear", "s"), ("delay|none|time_of_campaign:linear", "s/h")]
)
def test_a_delay_that_grows_over_the_campaign(fast, key, unit):
    """Each run reads as one that is late by its own delay; these runs were begun an hour apart."""
    channel, effect = fast["temperature"], described(key, False)

    def reading(one, size):
        model = Model(channel, Structure((one,)))
        start = model.start(np.full(channel.rates, np.log(0.3)), {f"{one.id}.size": size})
        return model.predict(Point(start, channel.at_rest()))[0]

    grown, plain = reading(effect, 0.02), described("delay|none", False)
    for run in (0, 4, 34):
        np.testing.assert_allclose(grown[run], reading(plain, 0.02 * run)[run], atol=1e-12)
    assert not effect.of_sensor and effect.in_flight is None
    assert discovered_of(effect, {"size": (0.02, 0.001)}).size.unit == unit
