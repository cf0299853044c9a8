"""A headless Chromium that is told what to do: its debugging protocol over a pipe (JSON, a NUL after each message)."""

import fcntl
import json
import os
import select
import shutil
import subprocess
from contextlib import contextmanager

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
).split()
WITHIN_S = 60.0


@contextmanager
def page_at(url, profile):
    """A function that runs a script on the page and returns its value; promises are waited for."""
    to_browser, from_browser = os.pipe(), os.pipe()
    given = [fcntl.fcntl(fd, fcntl.F_DUPFD, 10) for fd in (to_browser[0], from_browser[1])]
    os.close(to_browser[0])
    os.close(from_browser[1])
    process = subprocess.Popen(
        ["bash", "-c", f'exec "$@" 3<&{given[0]} 4>&{given[1]}', "bash", CHROMIUM, *FLAGS]
        + ["--remote-debugging-pipe", f"--user-data-dir={profile}", "about:blank"],
        pass_fds=given,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    for fd in given:
        os.close(fd)
    numbers, heard = iter(range(1, 1 << 30)), b""

    def call(method, session=None, **parameters):
        nonlocal heard
        number = next(numbers)
        message = {"id": number, "method": method, "params": parameters} | ({"sessionId": session} if session else {})
        os.write(to_browser[1], json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in heard:
                assert select.select([from_browser[0]], [], [], WITHIN_S)[0], f"no answer to {method}"
                chunk = os.read(from_browser[0], 1 << 16)
                assert chunk, "the browser has ended"
                heard += chunk
            one, heard = heard.split(b"\0", 1)
            answer = json.loads(one)
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return answer["result"]

    try:
        target = call("Target.createTarget", url=url)["targetId"]
        session = call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]

        def run(script):
            found = call(
                "Runtime.evaluate", session, expression=script, awaitPromise=True, returnByValue=True, userGesture=True
            )
            assert "exceptionDetails" not in found, found
            return found["result"].get("value")

        yield run
    finally:
        process.kill()
        process.wait()
        os.close(to_browser[1])
        os.close(from_browser[0])
