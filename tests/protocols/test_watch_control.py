"""Control from the live page: with the token that the terminal shows, from this machine alone; and what the recorder
does with it. Real HTTP requests on real sockets."""

import http.client
import json
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import pytest
from browser import CHROMIUM, FLAGS
from fake_bench import fake_bench, plan
from fake_bench import run as record
from made_recordings import STATUS, made_campaign, reading
from processes import ended, heard, wait_for
from test_watch import ROOT, live  # noqa: F401  a fixture

from shockrig.files.campaign import read_campaign
from shockrig.protocols.cli import main
from shockrig.protocols.watch.web import WatchServer
from shockrig.rig.bench_errors import BenchError, CampaignPaused
from shockrig.rig.observer import SilentObserver
from shockrig.rig.recorder import read_state
from shockrig.rig.requests import FILE, Inbox, Request, leave_request
from shockrig.rig.watch.follow import Follower

TOKEN = "correct-horse"
SKIP = {"action": "skip", "run": "0001"}


@contextmanager
def serving(path, token=TOKEN, host="127.0.0.1"):
    follower = Follower(path, time.monotonic)
    try:
        with WatchServer(follower, host, 0, token) as server:
            thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
            thread.start()
            try:
                yield server
            finally:
                server.shutdown()
                thread.join()
    finally:
        follower.close()


@pytest.fixture
def campaign(tmp_path):
    made_campaign(tmp_path / "c", [["step", 0.0, "soak"], reading("imet", 0.5, temperature_c=20.0)], STATUS)
    return tmp_path / "c"


def ask(server, body=SKIP, *, token=TOKEN, path="/control", method="POST", to="127.0.0.1", **headers):
    content = body if isinstance(body, bytes) else json.dumps(body).encode()
    connection = http.client.HTTPConnection(to, server.server_port, timeout=300)
    given = {"Host": f"127.0.0.1:{server.server_port}", "X-Shockrig-Token": token, **headers}
    try:
        connection.request(method, path, content, {name: value for name, value in given.items() if value is not None})
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    finally:
        connection.close()


def asked_for(campaign):
    """What lies there for the recorder, taken away."""
    file = campaign / FILE
    if not file.exists():
        return None  # and what is written from here on stays for the next look
    content = json.loads(file.read_text())
    file.unlink()
    return content


def test_with_the_token_a_request_reaches_the_recorder(campaign):
    with serving(campaign) as server:
        assert server.url.endswith(f"/#{TOKEN}")
        assert ask(server) == (202, "asked for\n")
        assert asked_for(campaign) == {"format": "shock-request/1", "action": "skip", "run": "0001", "text": ""}
        assert ask(server, Origin=f"http://localhost:{server.server_port}")[0] == 202
        assert ask(server)[0] == 409  # one at a time
        assert asked_for(campaign) is not None


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({"token": None}, 403),
        ({"token": ""}, 403),
        ({"token": TOKEN[:-1]}, 403),
        ({"token": TOKEN + "x"}, 403),
        ({"token": "corr\u00e9ct"}, 403),
        ({"Host": "evil.example"}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": "http://[::1"}, 403),
        ({"Content-Length": "999999"}, 413),
        ({"Content-Length": "-1"}, 413),
        ({"path": "/control/"}, 405),
        ({"path": "/"}, 405),
        ({"path": "/view.json"}, 405),
        ({"method": "PUT"}, 405),
        ({"method": "GET"}, 404),
        ({"body": b"{"}, 409),
        ({"body": [1]}, 409),
        ({"body": {"action": "abort", "run": "0001"}}, 409),
        ({"body": {"action": ["skip"], "run": "0001"}}, 409),
        ({"body": {"action": "note", "text": " "}}, 409),
        ({"body": {"action": "note", "text": "two\nlines"}}, 409),
        ({"body": {"action": "note", "text": "x" * 501}}, 409),
    ],
)
def test_everything_else_is_refused_and_changes_nothing(campaign, changes, status):
    with serving(campaign) as server:
        found, said = ask(server, **changes)
        assert found == status and (said.count("\n") == 1 and "Traceback" not in said)
        assert asked_for(campaign) is None
        assert ask(server)[0] == 202  # the server goes on


def test_a_page_without_control_can_only_be_read(campaign):
    with serving(campaign, token="") as server:
        assert ask(server)[0] == 405 and ask(server, token="")[0] == 405
        assert asked_for(campaign) is None


def own_address():
    """An address of this machine that is not its loopback; None where it has none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends nothing
        except OSError:
            return None
        address = probe.getsockname()[0]
    return None if address.startswith(("127.", "0.")) else address


def test_another_address_is_refused_even_with_the_token(campaign):
    address = own_address()
    if address is None:
        pytest.skip("this machine has no address but its loopback")
    with serving(campaign, host="0.0.0.0") as server:
        assert ask(server, to=address, Host=f"{address}:{server.server_port}") == (403, "only from this machine\n")
        assert asked_for(campaign) is None
        assert ask(server)[0] == 202


def test_nothing_is_asked_of_a_recording_that_has_ended(campaign):
    (campaign / "status.json").write_text(json.dumps(STATUS | {"state": "ended"}))
    with serving(campaign) as server:
        assert ask(server) == (409, "nothing is being recorded\n")
        assert asked_for(campaign) is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--control"], "--control: is for the page; give --web too"),
        (["--web", "--control", "--host", "0.0.0.0"], "only this machine may control; leave --host out"),
    ],
)
def test_control_is_for_the_page_of_this_machine(campaign, capsys, arguments, message):
    assert main(["watch", str(campaign), *arguments]) == 2
    assert message in capsys.readouterr().err


class Asking(SilentObserver):
    """Asks once, in the n-th step of a run."""

    def __init__(self, path, number, request):
        self.path, self.number, self.request, self.steps, self.said = path, number, request, 0, []

    def step_began(self, step, now_s):
        self.steps += 1
        if self.steps == self.number:
            leave_request(self.path, self.request)

    def say(self, text):
        self.said.append(text)


def asked_in(path, number, action, run="0001", text=""):
    """A campaign of two runs of four steps, with a request in the n-th step of all."""
    bench, watcher = fake_bench(), Asking(path, number, Request(action, run, text))
    recorded = record(bench, path, plan(2), watcher)
    assert not (path / FILE).exists()
    return recorded, watcher.said, bench


@pytest.mark.parametrize("step", [1, 2, 4])
def test_a_run_is_skipped_in_any_of_its_steps(tmp_path, step):
    recorded, said, bench = asked_in(tmp_path / "c", step, "skip")
    assert recorded == ["0002"] and any("run 0001 is skipped from the live page" in text for text in said)
    (aside,) = read_state(tmp_path / "c").set_aside
    assert aside.status == "interrupted" and aside.reason == "skipped from the live page"
    assert bench.stage.log.index("safe") < bench.stage.log.index("prepare", 3)  # made safe before the next run


def test_a_run_is_repeated_which_is_no_fault(tmp_path):
    recorded, said, _ = asked_in(tmp_path / "c", 2, "repeat")
    assert recorded == ["0001", "0002"] and len(read_state(tmp_path / "c").set_aside) == 1
    assert "run 0001: to be repeated, as the live page asked" in said


def test_a_pause_keeps_what_there_is_and_the_campaign_goes_on(tmp_path):
    with pytest.raises(CampaignPaused, match="paused from the live page"):
        asked_in(tmp_path / "c", 6, "pause", run="0002")
    assert read_state(tmp_path / "c").recorded == ("0001",)
    assert record(fake_bench(), tmp_path / "c", plan(2)) == ["0002"]


def test_a_note_goes_into_the_run(tmp_path):
    recorded, said, _ = asked_in(tmp_path / "c", 4, "note", text="a door was opened \u00fc")
    assert recorded == ["0001", "0002"] and "note: a door was opened \u00fc" in said
    (note,) = read_campaign(tmp_path / "c").runs[0].extra["notes"]
    assert note["text"] == "a door was opened \u00fc" and 5.0 <= note["time_s"] < 7.0


def test_a_request_for_a_run_that_has_ended_changes_nothing(tmp_path):
    recorded, said, _ = asked_in(tmp_path / "c", 6, "skip", run="0001")
    assert recorded == ["0001", "0002"]
    assert "a request to skip came from the live page after run 0001 had ended" in said


@pytest.mark.parametrize("content", ["", "{", "[]", '{"format": "shock-request/1", "action": "abort"}', "\x00" * 70])
def test_whatever_lies_there_is_survived_and_taken_away(tmp_path, content):
    (tmp_path / FILE).write_text('{"format": "shock-request/1", "action": "skip", "run": "0001"}')
    clock = iter(range(100))
    inbox = Inbox(tmp_path, lambda: next(clock))
    assert inbox.take() is None  # from before the recording began
    (tmp_path / FILE).write_text(content)
    assert inbox.take() is None and not (tmp_path / FILE).exists()


def test_a_folder_that_cannot_be_written_is_told(tmp_path):
    with pytest.raises(OSError):
        leave_request(tmp_path / "gone", Request("pause", "0001"))
    with pytest.raises(BenchError, match="not known"):
        Request("launch", "0001")


def test_from_the_address_in_the_terminal_to_the_recorder(live):  # noqa: F811
    """The command's own token, a recording in real time, and a page that is opened late."""
    recorder, out = live
    command = [sys.executable, "-m", "shockrig", "watch", str(out), "--web", "--control"]
    with subprocess.Popen(command, cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as watching:
        try:
            url = heard(watching, watching.stdout, "http").split()[0]
            port, token = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/#([\w-]{16,})", url).groups()
            connection = http.client.HTTPConnection("127.0.0.1", int(port), timeout=300)

            def view():
                connection.request("GET", "/view.json")
                return json.loads(connection.getresponse().read())

            wait_for(lambda: view()["transfer_s"] is not None)
            for action, text in (("note", "late but here"), ("pause", "")):
                body = json.dumps({"action": action, "run": view()["run"], "text": text})
                connection.request("POST", "/control", body, {"X-Shockrig-Token": token})
                assert connection.getresponse().read() == b"asked for\n"
                connection.close()
                wait_for(lambda: not (out / FILE).exists())
            said = ended(recorder)[1]
            assert recorder.returncode == 2 and "paused from the live page" in said
            late = wait_for(lambda: (seen := view())["state"] == "ended" and seen)
            assert late["alarms"] == ["ended: paused from the live page; the same command goes on from here"]
            assert [text for _, text in late["notes"]] == ["late but here"]
            connection.close()
            if CHROMIUM is not None:
                profile = f"--user-data-dir={out.parent / 'browser'}"
                seen = subprocess.run(
                    [CHROMIUM, *FLAGS, profile, "--virtual-time-budget=2000", "--dump-dom", url],
                    capture_output=True,
                    text=True,
                    timeout=300,
                ).stdout
                assert "<title>ALARM - " in seen and '<section id="control" aria-labelledby="h-control">' in seen
                assert re.search(r"<li>[\d.]+ s: late but here</li>", seen) and token not in seen
        finally:
            ended(watching, signal.SIGTERM)


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine: the page is not worked in a browser")
def test_the_page_is_worked_in_a_browser(tmp_path):
    """Buttons, note and zoom, bell and alarm; a page without the token shows no control."""
    from browser import page_at

    records = [["step", 0.0, "soak"], ["zero", 0.0, ""], ["step", 5.0, "record 20 s"], ["move", 5.2, 5.6]]
    records += [reading("imet", 0.1 * i, temperature_c=20.0 + (i > 52)) for i in range(200)]
    made_campaign(tmp_path / "c", records, STATUS)
    with serving(tmp_path / "c") as server, page_at(server.url, tmp_path / "profile") as run:
        wait_for(lambda: run("document.title") == "c - recording")
        assert run("location.href") == server.url.partition("#")[0]  # the token is out of sight
        assert run("document.getElementById('now').textContent") == "record, 5 s left. Nothing for you to do."
        run("window.confirm = () => true")
        for button, action in (("pause", "pause"), ("skip", "skip"), ("repeat", "repeat")):
            run(f"document.getElementById('{button}').click()")
            assert wait_for(lambda: asked_for(tmp_path / "c"))["action"] == action
        run("document.getElementById('note').value = 'fan rattles'; document.getElementById('take').click()")
        assert wait_for(lambda: asked_for(tmp_path / "c")) == {
            "format": "shock-request/1",
            "action": "note",
            "run": "0001",
            "text": "fan rattles",
        }
        wait_for(lambda: run("document.getElementById('note').value") == "")
        count = "document.querySelector('polyline').getAttribute('points').split(' ').length"
        assert run(count) == 200
        run("document.getElementById('zoom').value = '5'")
        assert wait_for(lambda: (n := run(count)) != 200 and n) == 56  # from 0.5 s before the transfer
        # The tones themselves need a loudspeaker: what is rung for is written down in their place.
        run("window.rang = []; tones = (hertz) => rang.push(hertz.length)")
        prompt = {"text": "Put the probes into the source air", "keys": "Enter goes on", "deadline_s": 300.0}
        (tmp_path / "c/status.json").write_text(json.dumps(STATUS | {"prompt": prompt}))
        wait_for(lambda: run("rang.join()") == "2")
        assert run("document.title") == "YOUR TURN - c - asking"
        gone = {"host": socket.gethostname(), "pid": 1 << 22}  # beyond every process
        (tmp_path / "c/status.json").write_text(json.dumps(STATUS | gone))
        wait_for(lambda: run("rang.join()") == "2,4")
        assert run("document.title") == "ALARM - c - cut off"
        assert "the recorder is gone" in run("document.getElementById('alarms').textContent")
    with serving(tmp_path / "c", token="") as server, page_at(server.url, tmp_path / "other") as run:
        wait_for(lambda: run("document.title") == "ALARM - c - cut off")
        assert run("document.getElementById('control').hidden")


def test_a_client_that_hangs_up_or_lies_is_no_traceback(campaign, capfd, monkeypatch):
    """It resets the connection, states a length of 5000 digits, or sends its body byte by byte: the thread is free
    again in time, and nothing is printed."""
    monkeypatch.setattr("shockrig.protocols.watch.web.REQUEST_WITHIN_S", 0.5)
    with serving(campaign) as server:
        here = ("127.0.0.1", server.server_port)
        head = f"POST /control HTTP/1.0\r\nHost: 127.0.0.1\r\nX-Shockrig-Token: {TOKEN}\r\nContent-Length: "
        for _ in range(20):
            with socket.create_connection(here, timeout=60) as client:
                client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                client.sendall(b"GET /page.js HTTP/1.0\r\nHost: 127.0.0.1\r\n\r\n")
        with socket.create_connection(here, timeout=60) as client:
            client.sendall(f"{head}{'9' * 5000}\r\n\r\n".encode())
            assert b"413" in client.recv(100)
        with socket.create_connection(here, timeout=60) as client:
            client.sendall(f"{head}40\r\n\r\n".encode() + b"{")
            client.recv(100)  # hung up on after half a second: it would wait here a minute
        assert ask(server)[0] == 202
    assert capfd.readouterr().err == ""
