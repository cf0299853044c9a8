"""What must hold of protocol files: the shipped ones fit their purpose, a slip of the pen is named with its remedy."""

import math
from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.protocol import Record, Soak, Transfer, load_protocol, parse_protocol, shipped_protocols


def vapour_pressure_hpa(air):
    """Magnus form over water (Sonntag 1990)."""
    t = air.temperature_c
    return 6.112 * math.exp(17.62 * t / (243.12 + t)) * air.humidity_percent / 100


def after_transfer_s(run):
    steps = list(run.steps)
    return sum(s.for_s for s in steps[[type(s) for s in steps].index(Transfer) :] if isinstance(s, Record))


def condition(run):
    return (run.source, run.destination, run.airflow_m_s)


STANDARD = load_protocol("standard").runs


def test_standard_covers_five_ambients_with_both_directions():
    by_ambient = {}
    for run in STANDARD:
        by_ambient.setdefault(run.destination.temperature_c, []).append(run)
    assert sorted(by_ambient) == [0, 10, 20, 30, 40]
    for runs in by_ambient.values():
        changes = [
            run.destination.humidity_percent - run.source.humidity_percent
            for run in runs
            if run.source.temperature_c == run.destination.temperature_c
        ]
        assert min(changes) <= -60 and max(changes) >= 60 and any(10 <= change <= 20 for change in changes)
        assert any(condition(a) == condition(b) for a, b in combinations(runs, 2)), "no repeated condition"
    assert 30 <= len(STANDARD) <= 36


def test_standard_closes():
    """What drifts is told from what depends on the ambients, which follow one another."""
    first, last = STANDARD[0], STANDARD[-1]
    assert condition(last) == condition(first) and last.steps == first.steps
    assert load_protocol("extended").continues == len(STANDARD)


def test_standard_thermal_shocks_keep_the_vapour_pressure():
    """Within 15 %: what is left is a small step beside the humidity shocks' factor of four."""
    thermal = [run for run in STANDARD if run.source.temperature_c != run.destination.temperature_c]
    rises = [run.destination.temperature_c - run.source.temperature_c for run in thermal]
    assert min(rises) <= -20 and max(rises) >= 20 and any(0 < abs(rise) < 8 for rise in rises)
    for run in thermal:
        assert vapour_pressure_hpa(run.destination) / vapour_pressure_hpa(run.source) == pytest.approx(1, abs=0.15)


def test_standard_has_three_airflows_for_the_same_shocks():
    flows = {}
    for run in STANDARD:
        flows.setdefault((run.source, run.destination), set()).add(run.airflow_m_s)
    assert sum(len(speeds) == 3 for speeds in flows.values()) >= 3


def test_shipped_transients_are_long_enough_for_slow_films():
    """Standard: 70 s, and longer in the cold, where a film is two to five times slower than at 40 degC."""
    assert all(after_transfer_s(run) >= 70 for run in (*STANDARD, *load_protocol("manual").runs))
    cold = [run for run in STANDARD if run.destination.temperature_c <= 10]
    assert all(after_transfer_s(run) >= 100 for run in cold)


def test_quick_is_one_ambient_in_about_a_minute():
    runs = load_protocol("quick").runs
    assert len({run.destination.temperature_c for run in runs}) == 1
    assert 50 <= sum(run.shortest_s() for run in runs) <= 90


def test_manual_keeps_to_two_chambers():
    """A person changes a chamber's air between runs, but has only two: none of the runs needs a third at once."""
    runs = load_protocol("manual").runs
    airs = {air for run in runs for air in (run.source, run.destination)}
    assert len(airs) <= 4
    assert len({frozenset((run.source, run.destination)) for run in runs}) == 2


def test_every_shipped_protocol_loads_and_says_what_it_is():
    assert {"quick", "standard", "manual"} <= set(shipped_protocols())
    for name in shipped_protocols():
        protocol = load_protocol(name)
        assert protocol.name == name and protocol.description
        assert len({run.id for run in protocol.runs}) == len(protocol.runs)


def test_a_step_reads_like_english():
    soak = "soak at the source until the reference is stable to 0.05 K and 0.3 %RH over 30 s, at most 20 min"
    assert str(Soak()) == soak
    assert [str(step) for step in STANDARD[0].steps[1:]] == ["record 10 s", "transfer, at most 20 s", "record 150 s"]


GOOD = """
format = "shock-protocol/1"
name = "mine"
airflow_m_s = 5.0
[faults]
repeat_at_most = 1
[steps]
usual = [
  { do = "soak", over_s = 30, at_most_s = 600 },
  { do = "record", for_s = 10 },
  { do = "transfer" },
  { do = "record", for_s = 70 },
]
[[run]]
source = { temperature_c = 20, humidity_percent = 20 }
destination = { temperature_c = 20, humidity_percent = 80 }
"""


def test_a_file_of_ones_own_is_read(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(GOOD)
    protocol = load_protocol(path)
    (run,) = protocol.runs
    assert run.id == "0001" and run.airflow_m_s == 5.0 and protocol.faults.repeat_at_most == 1
    assert run.steps[0] == Soak(over_s=30, at_most_s=600)
    assert run.shortest_s() == pytest.approx(111) and run.longest_s() == pytest.approx(700)


SLIPS = [
    ("airflow_m_s = 5.0", "airflow_ms = 5.0", "unknown key 'airflow_ms'; did you mean 'airflow_m_s'?"),
    ("for_s = 10", "for_sec = 10", "steps.usual, step 2: unknown key 'for_sec'; did you mean 'for_s'?"),
    ("at_most_s = 600", "at_most = 600", "step 1: unknown key 'at_most'; did you mean 'at_most_s'?"),
    ('do = "transfer"', 'do = "transfr"', "do = 'transfr' is not an action; did you mean 'transfer'?"),
    ("repeat_at_most", "repeats_at_most", "faults: unknown key 'repeats_at_most'; did you mean 'repeat_at_most'?"),
    ("repeat_at_most = 1", "repeat_at_most = 1.5", "repeat_at_most is 1.5; expected a whole number"),
    ("humidity_percent = 80", "humidity_percent = 180", "run 1: destination: humidity_percent is 180; expected"),
    ("temperature_c = 20, humidity_percent = 20", "temp = 20", "run 1: source: unknown key 'temp'"),
    ("for_s = 70", "for_s = nan", "for_s is nan; expected a number"),
    ("for_s = 70", "for_s = 0", "for_s is 0; expected more than 0"),
    (", for_s = 70 }", " }", "for_s is missing"),
    ('  { do = "transfer" },\n', "", "a run has one transfer, this one has 0"),
    ('  { do = "record", for_s = 10 },\n', "", "the plateau before the transfer and the transient after it"),
    ('"shock-protocol/1"', '"shock-protocol/9"', "format is 'shock-protocol/9'"),
    ("[[run]]", '[[run]]\nsteps = "usal"', "steps = 'usal' is not defined; did you mean 'usual'?"),
    ("name =", "name", "not TOML"),
]


@pytest.mark.parametrize(("before", "after", "message"), SLIPS)
def test_a_slip_is_named_with_its_remedy(before, after, message):
    assert before in GOOD
    with pytest.raises(BenchError) as caught:
        parse_protocol(GOOD.replace(before, after, 1).encode(), "mine.toml")
    assert str(caught.value).startswith("mine.toml") and message in str(caught.value)


def test_a_protocol_that_is_not_there(tmp_path):
    with pytest.raises(
        BenchError, match=r"standrad: No such file.*'standard'\? Else .*\(extended, manual, quick, standard\)"
    ):
        load_protocol("standrad")


@given(st.binary(max_size=200), st.integers(0, len(GOOD)), st.integers(0, 40))
def test_no_file_ends_in_anything_but_a_protocol_or_a_bench_error(junk, at, cut):
    """Mutations of a good file: bytes put in, bytes taken out."""
    content = GOOD.encode()
    try:
        protocol = parse_protocol(content[:at] + junk + content[at + cut :], "mutant.toml")
    except BenchError as error:
        assert str(error).startswith("mutant.toml")
    else:
        assert protocol.runs and all(math.isfinite(run.longest_s()) for run in protocol.runs)
