"""What nobody means well, or a disk that fails: one sentence each, and no traceback."""

import os
import shutil
from pathlib import Path

import pytest

from shockrig.files.campaign import read_campaign
from shockrig.files.errors import InputError
from shockrig.files.exports import write_netcdf, write_parquet
from shockrig.protocols.cli import main
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.toml_text import read_toml

ROWS = "".join(f"{k},{20 + k % 3},{40 + k % 5}\n" for k in range(50))
UNDECODABLE = os.fsdecode(b"o\xff\xfe")


@pytest.mark.parametrize("line", [0, 1, 60])
@pytest.mark.parametrize("command", ["look", "one run"])
def test_a_cell_of_600_kb_is_refused(tmp_path, capsys, line, command):
    lines = ["time_s,temperature_c,humidity_percent", *ROWS.splitlines()]
    lines.insert(line, '"' + "x" * 600_000 + '",b,c')
    log = tmp_path / "log.csv"
    log.write_text("\n".join(lines) + "\n")
    way = [str(log), "--look"] if command == "look" else ["--imet", str(log)]
    assert main(["import", *way, "--out", str(tmp_path / "out")]) == 2
    assert "log.csv: field larger than field limit" in capsys.readouterr().err
    assert os.listdir(tmp_path) == ["log.csv"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = " + "[" * 5000 + "]" * 5000, "brackets within brackets"),
        ("x = " + "9" * 6000, "not TOML: Exceeds the limit"),
        ("x = 0x" + "f" * 6000, "a whole number of more than 64 bits"),
        (".".join(["a"] * 100_000) + " = 1", "line 1: not TOML: 99999 points in it"),
        ("x = {a = [0x" + "f" * 20 + "]}", "more than 64 bits"),
    ],
    ids=["nested", "decimal", "hexadecimal", "a key of many parts", "below"],
)
def test_toml_beyond_all_sense_is_refused(text, said):
    with pytest.raises(BenchError, match=said):
        read_toml(text, "m.toml")


def test_a_name_that_is_no_text_is_written_to_or_refused(tmp_path):
    """Pages and tables take it; netCDF and Parquet, whose libraries do not, say so."""
    source = tmp_path / UNDECODABLE
    shutil.copytree(Path("data/examples/plain-rough"), source)
    head = (source / "campaign.json").read_text()
    (source / "campaign.json").write_text(head.replace('"name"', '"was"'))
    campaign = read_campaign(source)
    assert campaign.name.isprintable()
    write_netcdf(campaign, tmp_path / "o.nc", "made")
    for write in (lambda c, path: write_netcdf(c, path, "made"), write_parquet):
        with pytest.raises(InputError, match="its name is no text in UTF-8"):
            write(campaign, tmp_path / (UNDECODABLE + ".nc"))


def test_a_disk_that_fails_is_said_in_one_line(tmp_path, capsys, monkeypatch):
    def fails(*_):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("shockrig.protocols.commands.list_campaigns.main", fails)
    assert main(["list", str(tmp_path)]) == 2
    assert "shockrig list: Input/output error" in capsys.readouterr().err
