"""What must hold of the page: it shows the values in a real browser, runs nothing from names, and can only be read."""

import http.client
import json
import re
import subprocess
import threading
import time

import pytest
from browser import CHROMIUM, FLAGS
from made_recordings import STATUS, made_campaign, reading

from shockrig.protocols.watch.web import WatchServer
from shockrig.rig.watch.follow import Follower

RAN = "document.title='ran'"


@pytest.fixture
def server(tmp_path):
    """A page on a made campaign whose every name would like to run."""
    path = tmp_path / f"<script>{RAN}<"
    records = [["step", 0.0, "soak"], ["zero", 0.0, ""], ["step", 5.0, "record 20 s"]]
    records += [["move", 2.5, 2.9]]
    records += [reading("imet", 0.1 * i, temperature_c=20.0 + 0.1 * i) for i in range(101)]
    records += [reading("hyt", 0.1 * i, humidity_percent=40.0, temperature_c=22.0) for i in range(101)]
    status = STATUS | {
        "protocol": f"</title><script>{RAN}</script>",
        "bench": f'"><svg onload="{RAN}">',
        "messages": [f"<iframe srcdoc='<script>parent.{RAN}</script>'></iframe>"],
    }
    made_campaign(path, records, status)
    campaign = json.loads((path / "campaign.json").read_text())
    campaign["plan"][0]["note"] = f'<a href="javascript:{RAN}">note</a>'
    campaign["plan"][1]["note"] = f"<img src=x onerror={RAN}>"
    (path / "campaign.json").write_text(json.dumps(campaign))
    follower = Follower(path, time.monotonic)
    with WatchServer(follower, "127.0.0.1", 0) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
        thread.start()
        yield server
        server.shutdown()
        thread.join()
    follower.close()


def ask(server, path, method="GET", host=None):
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=300)
    try:
        connection.putrequest(method, path, skip_host=True)
        if host != "":
            connection.putheader("Host", host or f"127.0.0.1:{server.server_port}")
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.read(), dict(answer.getheaders())
    finally:
        connection.close()


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine: the page is not looked at in a browser")
def test_the_page_in_a_browser(server, tmp_path):
    profile = f"--user-data-dir={tmp_path / 'profile'}"
    command = [CHROMIUM, *FLAGS, profile, "--virtual-time-budget=2000", "--dump-dom", server.url]
    shown = subprocess.run(command, capture_output=True, text=True, timeout=300).stdout
    assert "<title>&lt;script&gt;document.title='ran'&lt; - recording</title>" in shown
    # Values, traces, plan and health are there.
    assert "30.00 °C" in shown and "40.0 %RH" in shown and "imet temperature in °C: 30.00" in shown
    traces = re.findall(r'<polyline class="trace (\w+)" points="([^"]*)"', shown)
    assert [kind for kind, _ in traces] == ["temperature", "humidity", "temperature"]
    points = [tuple(map(float, point.split(","))) for point in traces[0][1].split()]
    assert len(points) == 101
    slopes = [(b[1] - a[1]) / (b[0] - a[0]) for a, b in zip(points, points[10::], strict=False)]
    assert max(slopes) < 0 and max(slopes) - min(slopes) < 0.05  # a rising straight line, downwards in pixels
    assert shown.count('data-state="good"') == 2 and '<tr class="now"><td>0001</td>' in shown
    assert 'class="transfer"' in shown
    # No name has become an element, an attribute or a script.
    assert re.findall(r"<script[^>]*>", shown) == ['<script src="page.js" defer="">']
    assert not re.findall(r"<(img|iframe|a)\b", shown) and len(re.findall(r"<svg\b", shown)) == 3
    for name in ("&lt;img src=x", "&lt;svg onload=", "&lt;iframe srcdoc=", "&lt;a href=", "&lt;/title&gt;"):
        assert name in shown


def test_the_page_follows_the_recording(server):
    view = json.loads(ask(server, "/view.json")[1])
    assert view["state"] == "recording" and view["traces"][0]["points"][-1] == [10.0, 30.0]
    assert view["summary"] == "0 of 3 runs recorded"


def test_the_policy_forbids_what_a_name_could_do(server):
    for path in ("/", "/page.js", "/page.css", "/view.json"):
        status, content, headers = ask(server, path)
        policy = dict(part.strip().split(" ", 1) for part in headers["Content-Security-Policy"].split(";"))
        assert status == 200 and policy["default-src"] == "'none'" and policy["script-src"] == "'self'"
        assert "unsafe" not in headers["Content-Security-Policy"] and policy["frame-ancestors"] == "'none'"
        assert headers["X-Content-Type-Options"] == "nosniff" and headers["Cache-Control"] == "no-store"
        assert b"http://" not in content.replace(b"http://www.w3.org/2000/svg", b"") and b"https://" not in content
    script = ask(server, "/page.js")[1]
    for unsafe in (b"innerHTML", b"outerHTML", b"insertAdjacent", b"eval(", b"document.write", b"Function("):
        assert unsafe not in script


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "HEAD", "TRACE"])
def test_the_page_can_only_be_read(server, method):
    status, _, headers = ask(server, "/view.json", method)
    assert status == 405 and headers["Allow"] == "GET"


@pytest.mark.parametrize(
    ("host", "status"),
    [
        (None, 200),
        ("localhost:8000", 200),  # through an SSH tunnel
        ("[::1]:8000", 200),
        ("evil.example", 421),
        ("127.0.0.1.evil.example:80", 421),
        ("evil.example@127.0.0.1.x", 421),
        ("[::1", 421),
        ("", 421),
    ],
)
def test_names_of_others_are_not_served(server, host, status):
    for path in ("/", "/view.json"):
        assert ask(server, path, host=host)[0] == status


@pytest.mark.parametrize("path", ["/etc/passwd", "/../campaign.json", "/page.html", "/view.json?x", "*"])
def test_nothing_else_is_served(server, path):
    assert ask(server, path)[0] == 404


def test_only_this_computer_unless_asked(server):
    assert server.socket.getsockname()[0] == "127.0.0.1"
