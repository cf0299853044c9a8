"""A sample of benchmarks/fuzz_parsers.py: damaged lines, frames and files through every parser and reader."""

import random

import pytest
from benchmark_scripts import benchmark

fuzz = benchmark("fuzz_parsers")
damage = benchmark("fuzz_damage").damage
COUNTS = {
    "imet": 4000, "frames": 5000, "grbl": 1500, "journals": 300, "profiles": 250, "diagnoses": 250, "benches": 150,
    "protocols": 250, "truths": 150, "campaigns": 60, "flights": 120,
}  # fmt: skip


@pytest.mark.parametrize("target", list(COUNTS))
def test_no_damaged_input_does_harm(target, tmp_path):
    tally, wrong = fuzz.fuzz(target, COUNTS[target], seed=12345, folder=tmp_path)
    assert not wrong
    assert tally["accepted"] > 0 and tally["refused"] > 0  # the damage is neither total nor harmless


def test_every_target_is_in_the_sample():
    assert set(fuzz.targets()) == set(COUNTS)
    assert sum(target.share for target in fuzz.targets().values()) == pytest.approx(1.0)


def test_damage_damages():
    rng = random.Random(1)
    assert sum(damage(rng, b"5,2512,5376\r\n") != b"5,2512,5376\r\n" for _ in range(1000)) > 950


def test_a_number_of_five_thousand_digits_is_refused_everywhere(tmp_path):
    """Python itself refuses to convert it, with an error of another kind."""
    from shockrig.files.campaign import read_campaign
    from shockrig.files.errors import InputError
    from shockrig.rig.bench_errors import BenchError
    from shockrig.rig.bench_file import load_bench
    from shockrig.rig.protocol import parse_protocol
    from shockrig.rig.recorder import read_state

    digits = "9" * 5000
    (tmp_path / "campaign.json").write_text('{"format": ' + digits + "}")
    with pytest.raises(InputError, match="not JSON"):
        read_campaign(tmp_path)
    with pytest.raises(BenchError, match="not JSON"):
        read_state(tmp_path)
    (tmp_path / "b.toml").write_text(f"a = {digits}")
    with pytest.raises(BenchError, match="not TOML"):
        load_bench(tmp_path / "b.toml")
    with pytest.raises(BenchError, match="not TOML"):
        parse_protocol(f"a = {digits}".encode(), "p.toml")
