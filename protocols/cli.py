"""The command line: parse, call one function, print.

A command is one file in protocols/commands and one line in COMMANDS.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence

from shockrig.protocols.parser import Parser, meant_or

TYPE_CHECKING = False  # as in shockrig/__init__.py
if TYPE_CHECKING:
    from types import FrameType
    from typing import Any, NoReturn

# command -> (module in protocols.commands, what it does)
COMMANDS = {
    "scan": ("scan", "find sensors and stages on this computer and write a bench file to start from"),
    "bench": ("bench", "print a bench file that ships, to copy and edit"),
    "check": ("check", "open every instrument of a bench and say what works and what does not"),
    "run": ("run", "record a campaign on a bench (the embedded virtual bench by default)"),
    "import": ("import_logs", "turn other loggers' files, also one long log with many steps, into a campaign"),
    "plan": ("plan", "say which runs to record next for given goals, as a protocol, or say why none"),
    "watch": ("watch", "watch a campaign while it is recorded, in the terminal or in the browser"),
    "status": ("status", "say what a campaign holds, what is missing and why"),
    "list": ("list_campaigns", "list the campaigns of a folder, what they gave, and what changed from one to the next"),
    "export": ("export", "write a campaign as netCDF, Parquet or bluesky event documents"),
    "characterize": ("characterize", "fit alpha and D(T) to a campaign and write the sensor profile"),
    "diagnose": ("diagnose", "say what the simulation gets wrong, why, and what correcting it gains"),
    "reveal": ("reveal", "open a sealed truth beside a diagnosis and score it"),
    "certify": ("certify", "write uncertainty budgets and a calibration certificate, also as DCC XML"),
    "history": ("history", "chart the campaigns of one serial number, and say what changed and since when"),
    "learn": ("learn", "say what flights show of their sensor, without a bench"),
    "fleet": ("fleet", "say what many sensors of one type have in common, and which do not belong"),
    "correct": ("correct", "correct a flight's temperature and humidity with a profile"),
    "onboard": ("onboard", "write a profile's correction as a C and a Lua program for autopilots"),
    "fly": ("fly", "on a drone's computer: read sensors, correct, log, and send by MAVLink and DroneCAN"),
    "simulate": ("simulate", "simulate weather and a sensor flown through it, to files"),
    "example": ("example", "list or copy samples that ship: campaigns, a log with steps, a flight with position"),
    "tour": ("tour", "bench, log and flight in ten minutes, command by command"),
    "demo": ("demo", "hide an effect in virtual sensors, find it, extend the model, open the seal"),
    "demo-flights": ("demo_flights", "make the paper's flight figures again, three corrections side by side"),
    "emulate": ("emulate", "emulate instruments that unmodified programs open, or that play a flight"),
    "hil": ("hil", "play a flight through emulated sensors, fly and correct it, and say what each stage lost"),
    "hyt-address": ("hyt_address", "read a HYT-271's I2C address, or store another one in it"),
    "slips": ("slips", "show the published schemes as printed and corrected, against the exact series"),
}


LONGEST_MESSAGE = 800
AGAIN_S = 0.05  # after which a signal is sent again
_waiting: dict[int, threading.Timer] = {}  # signals that are to be sent again, and by what
LOADER = "<frozen importlib._bootstrap>"  # file of the frames that load a module
OPTIONS = ("-h", "--help", "--version", "--print-completion")  # of shockrig itself
SHELLS = ("bash", "zsh", "tcsh")
# Matrices here are small: threads of a linear algebra library would wait for one another. Read when NumPy is imported.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


def build_parser(command: str | None, *, every: bool = False) -> Parser:
    """Parser that knows every command's name and help, and the arguments of `command` alone (its imports are heavy).

    With `every` it knows the arguments of all commands, for completion and for the reference.
    """
    parser = Parser(
        prog="shockrig",
        description="Characterize, diagnose and correct the thermo-hygrometers that fly on weather drones.",
    )
    parser.add_argument("--version", action=_Version, help="print the version and end")
    parser.add_argument(
        "--print-completion",
        action=_Completion,
        choices=SHELLS,
        metavar="SHELL",
        help=f"print what makes {', '.join(SHELLS[:-1])} or {SHELLS[-1]} complete commands and options, and end",
    )
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, (module, summary) in COMMANDS.items():
        sub = subparsers.add_parser(name, help=summary, description=summary[0].upper() + summary[1:] + ".")
        if every or name == command:
            loaded = importlib.import_module(f"shockrig.protocols.commands.{module}")
            loaded.add_arguments(sub)
            sub.set_defaults(main=loaded.main, parser=sub)
    return parser


class _Version(argparse.Action):
    """`--version`: print the version of the installed distribution and end."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(nargs=0, default=argparse.SUPPRESS, **settings)

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from shockrig.protocols.folder import software_version

        print(f"shockrig {software_version()}")
        parser.exit()


class _Completion(argparse.Action):
    """`--print-completion SHELL`: print the shell's completion script and end; made from the parsers, by shtab."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(default=argparse.SUPPRESS, **settings)

    def __call__(self, parser: argparse.ArgumentParser, namespace: object, values: Any, *_: Any) -> None:
        from shockrig.protocols.completion import completion_script

        print(completion_script(build_parser(None, every=True), str(values)))
        parser.exit()


def main(argv: list[str] | None = None) -> int:
    """Run one command; 0 on success, 2 on bad arguments or bad input (one line on standard error), 130 on Ctrl-C."""
    for name in THREADS:
        os.environ.setdefault(name, "1")
    arguments = sys.argv[1:] if argv is None else argv
    command = next((a for a in arguments if not a.startswith("-")), None)
    parser = build_parser(command)
    if not arguments:
        parser.error("COMMAND is missing; shockrig --help lists the commands")
    if arguments[0].startswith("-"):
        if arguments[0].partition("=")[0] not in OPTIONS:
            parser.error(parser.unknown(arguments[0]))
    elif command not in COMMANDS:
        parser.error(
            f"no command {command!r}; {meant_or(str(command), COMMANDS, 'shockrig --help lists the commands')}"
        )
    args = parser.parse_args(arguments)
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors in ("strict", "surrogateescape"):
        sys.stdout.reconfigure(errors="backslashreplace")  # names of any bytes are printed
    from shockrig.files.disk import shown
    from shockrig.files.errors import InputError
    from shockrig.rig.bench_errors import CampaignAborted, ConnectionFaults, RigError

    try:
        with ended_by_signals(getattr(args, "ends_by_ctrl_c", False)):
            _check_common(arguments, args)
            return args.main(args) or 0
    except ConnectionFaults as error:
        for fault in error.faults:
            _tell(f"shockrig {args.command}: {fault}")
        return 2
    except CampaignAborted as error:
        _tell(f"shockrig {args.command}: {error}; what was recorded up to now is kept")
        return 130
    except (InputError, RigError) as error:
        _tell(f"shockrig {args.command}: {_one_line(str(error))}")
        return 2
    except KeyboardInterrupt:
        kept = "; what was recorded up to now is kept" if args.command in ("run", "demo") else ""
        _tell(f"shockrig {args.command}: stopped by Ctrl-C{kept}")
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 141
    except OSError as error:
        # Of a disk or a device that fails no file is named.
        where = f"{shown(os.fsdecode(error.filename))}: " if error.filename is not None else ""
        _tell(f"shockrig {args.command}: {where}{error.strerror or error}; give another path, or access to it")
        return 2


def _one_line(text: str) -> str:
    """A message on one line that can be read, whatever stands in the names and options that it tells of."""
    said = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    return (
        said if len(said) <= LONGEST_MESSAGE else f"{said[: LONGEST_MESSAGE // 2]} ... {said[-LONGEST_MESSAGE // 3 :]}"
    )


def _tell(text: str) -> None:
    """One line on standard error, where there is still somebody to read it."""
    try:
        print(text, file=sys.stderr, flush=True)
    except OSError:
        # A terminal that hung up: what waits for it would end the interpreter with a status of its own, 120.
        nobody = os.open(os.devnull, os.O_WRONLY)
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                os.dup2(nobody, stream.fileno())


@contextlib.contextmanager
def ended_by_signals(by_ctrl_c: bool = False) -> Iterator[None]:
    """SIGTERM and a closed terminal end a command as an exception does, so that it clears away what is half done.

    An exception that a signal raises in the middle of a deletion is dropped by Python, and in the middle of loading a
    module it may come out as another error (of a compiled library, of a class that is made): the signal is sent again.
    What is ignored (nohup) stays so, and a program that calls `main` keeps handlers of its own. `by_ctrl_c`: save for
    SIGINT, which everything ignores that a script starts in the background, where a command is to be ended by it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)}
    usual = [signal.SIG_DFL, signal.default_int_handler]
    ours = {number: handler for number, handler in handlers.items() if handler in usual}
    if by_ctrl_c and handlers[signal.SIGINT] is signal.SIG_IGN:
        ours[signal.SIGINT] = signal.SIG_IGN
    for number in ours:
        signal.signal(number, _end)
    before, sys.unraisablehook = sys.unraisablehook, _sent_again
    try:
        yield
        _end_by_waiting()
    except Exception:
        # Processes beside this one have ended by the same signal meanwhile: what comes of that is no error.
        _end_by_waiting()
        raise
    finally:
        sys.unraisablehook = before
        for number, handler in ours.items():
            signal.signal(number, handler)


def _end(number: int, frame: FrameType | None) -> None:
    if _loads_a_module(frame):
        _send_again(number)
    else:
        _raise(number)


def _end_by_waiting() -> None:
    """End by a signal that is still to be sent again: behind the command it would meet handlers of the caller's."""
    if _waiting:
        _raise(next(iter(_waiting)))


def _raise(number: int) -> NoReturn:
    if (again := _waiting.pop(number, None)) is not None:
        again.cancel()
    if number == signal.SIGINT:
        raise KeyboardInterrupt from None
    raise SystemExit(128 + number) from None


def _loads_a_module(frame: FrameType | None) -> bool:
    """Whether one is being loaded within a command, and not what has called it."""
    while frame is not None and frame.f_code is not main.__code__:
        if frame.f_code.co_filename == LOADER:
            return True
        frame = frame.f_back
    return False


def _sent_again(dropped: sys.UnraisableHookArgs) -> None:
    """What Python drops of signals is sent again; of the rest it says what it says."""
    match dropped.exc_value:
        case KeyboardInterrupt():
            _send_again(signal.SIGINT)
        case SystemExit(code=int(code)) if code > 128:
            _send_again(code - 128)
        case _:
            sys.__unraisablehook__(dropped)


def _send_again(number: int) -> None:
    again = _waiting[number] = threading.Timer(AGAIN_S, os.kill, (os.getpid(), number))
    again.daemon = True
    again.start()


def _check_common(arguments: Sequence[str], args: argparse.Namespace) -> None:
    """What holds for every command: no argument is empty, every path can be one, and a seed has 64 bits.

    Looked for in the words themselves, because an empty path is parsed as the folder that one stands in: a script whose
    variable is empty would write there.
    """
    from shockrig.files.disk import demand_name
    from shockrig.files.errors import InputError

    for before, word in zip(("", *arguments), arguments, strict=False):
        option, equals, value = word.partition("=") if word.startswith("--") else (before, "=", word)
        if equals and (not value.strip() or (option.startswith("--") and word == f"{option}=--")):
            said = f"{option}: is {'--' if value.strip() else 'empty'}; give a value, or leave it out"
            raise InputError(said if option.startswith("--") else "an argument is empty; give a value")
    for value in vars(args).values():
        for path in value if isinstance(value, list) else [value]:
            if isinstance(path, os.PathLike):
                demand_name(path, "give another path")
    if getattr(args, "seed", None) is not None:
        from shockrig.rig.bench_file import LARGEST_SEED

        if not 0 <= args.seed <= LARGEST_SEED:
            expected = f"expected a whole number from 0 to {LARGEST_SEED}, which is what 64 bits hold"
            raise InputError(f"--seed {args.seed}: {expected}")
