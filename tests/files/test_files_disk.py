"""Files that a user names are read within limits and never hang; files of ours appear whole or not at all."""

import json
import os
import resource
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from shockrig.files.campaign import read_campaign
from shockrig.files.diagnosis import read_diagnosis
from shockrig.files.disk import open_text, read_bytes, read_text, shown, write_whole
from shockrig.files.errors import InputError
from shockrig.files.flight import read_layout
from shockrig.files.json_files import parse_json, read_json, write_json
from shockrig.files.profile import read_profile
from shockrig.protocols.cli import main

READERS = {
    "bytes": lambda path: read_bytes(path, "name another"),
    "text": lambda path: read_text(path, "name another"),
    "stream": lambda path: open_text(path, "name another").close(),
    "json": lambda path: read_json(path, None, "name another"),
    "profile": read_profile,
    "diagnosis": read_diagnosis,
    "flight": read_layout,
}


def pipe(path):
    os.mkfifo(path)


def socket_file(path):
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(str(path))


def circle(path):
    path.symlink_to(path)


def unreadable(path):
    path.write_text("{}")
    path.chmod(0)


ODD = {
    "a pipe": (pipe, "is a pipe, expected a file"),
    "a folder": (Path.mkdir, "Is a directory, expected a file"),
    "a device": (lambda path: path.symlink_to("/dev/zero"), "is a device, expected a file"),
    "a socket": (socket_file, "is a socket, expected a file"),
    "a circle of links": (circle, "its links lead in a circle"),
    "a link to nothing": (lambda path: path.symlink_to(path.with_name("nowhere")), "No such file"),
    "nothing": (lambda path: None, "No such file"),
}


@pytest.mark.timeout(120)
@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_file_is_refused_at_once(tmp_path, monkeypatch, reader, odd):
    make, words = ODD[odd]
    monkeypatch.chdir(tmp_path)  # a socket's name must be short
    make(Path("odd"))
    with pytest.raises(InputError) as raised:
        READERS[reader](Path("odd"))
    assert str(raised.value).startswith(f"odd: {words}") and "\n" not in str(raised.value)


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize(
    ("name", "words"),
    [("x" * 300, "its name is too long"), ("a\0b", "is no file name"), ("a\ud800b", "is no file name")],
    ids=["too long", "NUL", "half a character"],
)
def test_a_name_that_cannot_be_one_is_refused(tmp_path, reader, name, words):
    with pytest.raises(InputError) as raised:
        READERS[reader](tmp_path / name)
    message = str(raised.value)
    assert words in message and "\n" not in message and len(message) < 700
    message.encode("utf-8")  # can be printed, and written into a report


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_that_may_not_be_read_says_so(tmp_path):
    unreadable(tmp_path / "p.json")
    with pytest.raises(InputError, match=r"p\.json: may not be read"):
        read_profile(tmp_path / "p.json")


def test_a_file_beyond_the_stated_limit_is_refused_before_it_is_read(tmp_path):
    with (tmp_path / "large.json").open("wb") as file:
        file.truncate(1 << 40)  # a hole: no disk has it
    with pytest.raises(InputError, match=r"large\.json: is larger than 64 MiB, the most that is read"):
        read_profile(tmp_path / "large.json")
    assert read_bytes(Path("/proc/self/status"), "x").startswith(b"Name:")  # a file that states no size
    (tmp_path / "five").write_bytes(b"12345")
    assert read_bytes(tmp_path / "five", "x", 5) == b"12345"
    with pytest.raises(InputError, match="is larger than"):
        read_bytes(tmp_path / "five", "x", 4)


@pytest.mark.timeout(120)
@pytest.mark.parametrize("name", ["campaign.json", "runs/0001/run.json", "runs/0001/imet.csv", "runs/0001/air.csv"])
@pytest.mark.parametrize("odd", ["a pipe", "a folder", "a circle of links", "a link to nothing"])
def test_nothing_in_a_campaign_makes_its_reader_hang_or_is_passed_over(tmp_path, name, odd):
    (tmp_path / "runs/0001").mkdir(parents=True)
    (tmp_path / "campaign.json").write_text('{"format": "shock-campaign/1"}')
    (tmp_path / "runs/0001/run.json").write_text('{"format": "shock-run/1"}')
    assert len(read_campaign(tmp_path).runs) == 1
    (tmp_path / name).unlink(missing_ok=True)
    make, words = ODD[odd]
    make(tmp_path / name)
    with pytest.raises(InputError) as raised:
        read_campaign(tmp_path)
    assert f"{Path(name).name}: {words}" in str(raised.value)


def test_a_run_behind_a_link_that_leads_nowhere_is_not_passed_over(tmp_path):
    (tmp_path / "runs/0001").mkdir(parents=True)
    (tmp_path / "campaign.json").write_text('{"format": "shock-campaign/1"}')
    (tmp_path / "runs/0001/run.json").write_text('{"format": "shock-run/1"}')
    (tmp_path / "runs/.0002.part").mkdir()
    (tmp_path / "runs/.0002.part/run.json").write_text("{")  # being written by an import
    assert [run.id for run in read_campaign(tmp_path).runs] == ["0001"]
    (tmp_path / "runs/0003").symlink_to("elsewhere/0003")
    with pytest.raises(InputError, match="0003: is a link that leads nowhere"):
        read_campaign(tmp_path)


@pytest.mark.timeout(120)
def test_the_command_line_refuses_a_pipe_in_one_line(tmp_path, capsys):
    os.mkfifo(tmp_path / "flight.csv")
    os.mkfifo(tmp_path / "profile.json")
    arguments = [
        str(tmp_path / "flight.csv"),
        "--profile",
        str(tmp_path / "profile.json"),
        "--out",
        str(tmp_path / "o"),
    ]
    assert main(["correct", *arguments]) == 2
    assert main(["import", "--imet", arguments[0], "--out", str(tmp_path / "campaign")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 2 and said.count("is a pipe, expected a file") == 2
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["flight.csv", "profile.json"]


def test_names_are_shown_on_one_line_whatever_their_bytes():
    assert shown("plain/ü.json") == "plain/ü.json"
    assert shown("two\nlines\x1b[31m") == "two\\nlines\\x1b[31m"
    assert shown(os.fsdecode(b"\xff.csv")) == "\\udcff.csv"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "x.json, line 1: not JSON"),
        ('{"a": 1,\n"b": oops}', "x.json, line 2: not JSON"),
        ('{"a": NaN}', "NaN is no number of JSON"),
        ("[" * 100_000, "not JSON"),
        ('{"a": ' + "9" * 5000 + "}", "not JSON"),
        ("[1]", "expected a JSON object, found a list"),
        ('{"a": {"b": ["\\ud800"]}}', "key a.b[0]: holds half of a character"),
        ('{"\\udfff": 1}', "holds half of a character"),
    ],
)
def test_what_is_no_json_object_says_where_and_why(text, words):
    with pytest.raises(InputError) as raised:
        parse_json(text, "x.json", None, "name another")
    message = str(raised.value)
    assert words in message and "\n" not in message
    message.encode("utf-8")


def test_whole_characters_written_in_halves_are_read():
    assert parse_json('{"a": "\\ud83d\\ude00"}', "x", None, "").text("a") == "\U0001f600"


def test_a_byte_order_mark_does_no_harm_and_other_encodings_are_said(tmp_path):
    (tmp_path / "a.json").write_bytes(b'\xef\xbb\xbf{"a": 1}')
    assert read_json(tmp_path / "a.json", None, "").get("a") == 1
    (tmp_path / "b.json").write_bytes('{\n"name": "Bücher"}'.encode("cp1252"))
    with pytest.raises(InputError, match=r"b\.json, line 2: not UTF-8 text"):
        read_json(tmp_path / "b.json", None, "name another")


def test_a_file_is_written_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a.json"
    write_json(path, {"a": [1.5, None], "ü": "\ud800"}, sync=True)
    assert path.read_bytes() == '{\n "a": [\n  1.5,\n  null\n ],\n "ü": "?"\n}\n'.encode()
    with pytest.raises(ValueError):
        write_json(path, {"a": float("nan")})
    with pytest.raises(OSError):
        write_whole(tmp_path / "none" / "a.json", "")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError):
        write_whole(tmp_path / "folder", "x")
    assert json.loads(path.read_text())["a"] == [1.5, None]
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["a.json", "folder"]


def test_a_disk_without_room_keeps_the_old_file_and_leaves_nothing(tmp_path):
    """A limit on file size instead of a full disk."""
    (tmp_path / "a.txt").write_text("old")
    code = (
        "import sys; from pathlib import Path; from shockrig.files.disk import write_whole\n"
        "try: write_whole(Path(sys.argv[1]), 'x' * 100_000)\n"
        "except OSError: sys.exit(7)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "a.txt")],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000)),
        timeout=300,
    )
    assert done.returncode == 7
    assert [(entry.name, entry.read_text()) for entry in tmp_path.iterdir()] == [("a.txt", "old")]
