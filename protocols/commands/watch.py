"""shockrig watch: a campaign while it is recorded, in the terminal or as a page."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from shockrig.rig.watch.follow import Follower


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(ends_by_ctrl_c=True)
    parser.epilog = (
        "Reads the campaign folder only, unless --control is given: start it and end it (Ctrl-C) when you like. The "
        "page has no password: give --host only in a network where everybody may see the measurement, and reach a "
        "bench elsewhere by ssh -L 8000:127.0.0.1:PORT."
    )
    parser.add_argument("campaign", metavar="CAMPAIGN", type=Path, help="campaign folder that is being recorded")
    parser.add_argument("--once", action="store_true", help="print one picture and end")
    parser.add_argument("--every", metavar="S", type=float, default=0.5, help="seconds between pictures (default: 0.5)")
    web = parser.add_argument_group("in the browser")
    web.add_argument("--web", action="store_true", help="serve a page instead")
    web.add_argument(
        "--control",
        action="store_true",
        help="the page may pause the campaign, skip or repeat the run and take notes: with the token in the address "
        "that is printed, and from this machine alone",
    )
    web.add_argument("--port", type=int, default=0, help="port of the page (default: any free one)")
    web.add_argument("--host", default="127.0.0.1", help="address to listen at (default: 127.0.0.1)")


def main(args: argparse.Namespace) -> int:
    import time

    from shockrig.files.errors import InputError
    from shockrig.rig.recorder.state import read_head
    from shockrig.rig.watch.follow import Follower

    if not 0.05 <= args.every <= 60.0:
        raise InputError(f"--every {args.every:g}: expected 0.05 to 60 s")
    if not 0 <= args.port <= 65535:
        raise InputError(f"--port {args.port}: expected 0 (any free one) to 65535")
    # Every writer puts campaign.json in its place whole, so one that is damaged now stays so while we look.
    read_head(args.campaign)
    if args.control and not args.web:
        raise InputError("--control: is for the page; give --web too")
    follower = Follower(args.campaign, time.monotonic)
    try:
        if args.web:
            _serve(args, follower)
        else:
            from shockrig.protocols.watch.terminal import watch_terminal

            watch_terminal(follower, time.sleep, args.every, args.once)
    except KeyboardInterrupt:
        pass  # watching ends as it began: the recording knows nothing of it
    finally:
        follower.close()
    return 0


def _serve(args: argparse.Namespace, follower: Follower) -> None:
    from shockrig.files.errors import InputError
    from shockrig.protocols.watch.web import is_local, serve

    token = ""
    if args.control:
        import secrets

        if not is_local(args.host):
            raise InputError(f"--control with --host {args.host}: only this machine may control; leave --host out")
        token = secrets.token_urlsafe(16)
        print("whoever has this address can pause, skip and repeat: keep it to yourself", file=sys.stderr)
    if not is_local(args.host):
        print(f"warning: whoever can reach {args.host} can see this page", file=sys.stderr)
    try:
        serve(follower, args.host, args.port, lambda url: print(f"{url}  (Ctrl-C ends it)", flush=True), token)
    except OSError as error:
        raise InputError(f"--host {args.host} --port {args.port}: {error.strerror}; give another") from None
