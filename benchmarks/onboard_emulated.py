"""What does a row cost on board? The generated C on an emulated AVR (cycles) and an emulated ARM (instructions).

    python benchmarks/onboard_emulated.py

Needs Debian's gcc-avr, avr-libc, simavr, gcc-arm-linux-gnueabihf, libc6-dev-armhf-cross and qemu-user; what lacks is
left out and said. The last row is printed by this computer's compiler as well: all of them should give the same.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.onboard import c_source, flown

HERE = Path(__file__).parent
LONGEST_S = 300


def done(*command: str) -> str:
    """What a command prints."""
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=LONGEST_S).stdout


def instructions(folder: Path, rows: int) -> int:
    """Instructions that an emulated ARM takes for so many rows."""
    program = str(folder / f"arm{rows}")
    options = ("-O2", "-std=c99", "-static", "-mcpu=cortex-a7", "-mfpu=vfpv4", f"-DROWS={rows}", f"-I{folder}")
    done("arm-linux-gnueabihf-gcc", *options, "-o", program, str(HERE / "onboard_arm.c"), *source(folder))
    log = folder / "executed"
    done("qemu-arm", "-singlestep", "-d", "exec,nochain", "-D", str(log), program)
    with log.open("rb") as stream:
        count = sum(line.startswith(b"Trace") for line in stream)
    log.unlink()
    return count


def source(folder: Path) -> tuple[str, str]:
    return str(folder / "shock_correct.c"), "-lm"


def main() -> int:
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for name, text in c_source(flown(typical_profile()), "typical", "benchmark").items():
            (folder / name).write_text(text)
        if shutil.which("cc"):
            done("cc", "-O2", f"-I{folder}", "-o", str(folder / "here"), str(HERE / "onboard_arm.c"), *source(folder))
            print(f"this computer: {done(str(folder / 'here')).strip()}")
        if shutil.which("avr-gcc") and shutil.which("simavr"):
            options = ("-O2", "-std=c99", "-mmcu=atmega1284p", "-DF_CPU=16000000UL", f"-I{folder}", f"-I{HERE}")
            program = str(folder / "avr.elf")
            done("avr-gcc", *options, "-o", program, str(HERE / "onboard_avr.c"), *source(folder))
            print(f"AVR, ATmega1284P: {done('avr-size', program).splitlines()[1].split()[0]} bytes of program")
            said = subprocess.run(
                ["simavr", "-m", "atmega1284p", "-f", "16000000", program], capture_output=True, text=True
            )
            print(
                next(line for line in (said.stdout + said.stderr).splitlines() if "cycles" in line).strip("\x1b[32m0.")
            )
        else:
            print("AVR: no avr-gcc or no simavr on this computer")
        if shutil.which("arm-linux-gnueabihf-gcc") and shutil.which("qemu-arm"):
            few, many = 40, 50
            each = (instructions(folder, many) - instructions(folder, few)) / (many - few)
            print(f"ARM with a floating-point unit (cortex-a7): {each:.0f} instructions a row")
            print(done("qemu-arm", str(folder / f"arm{few}")).strip())
        else:
            print("ARM: no arm-linux-gnueabihf-gcc or no qemu-arm on this computer")
    return 0


if __name__ == "__main__":
    sys.exit(main())
