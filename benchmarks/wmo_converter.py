"""Does WMO's public converter take our files? From an ArduPilot log that pymavlink wrote, in one command, to BUFR.

    python benchmarks/wmo_converter.py --converter uas2bufr.py

The converter is `uas_utils/uas2bufr.py` of github.com/synoptic/wmo-uasdc (ECMWF, Apache-2.0; not kept here); it needs
eccodes. Its own check of the file's name runs first, then its conversion; the message is decoded again and held against
the file.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import io
import sys
import tempfile
from pathlib import Path

import netCDF4
import numpy as np

from shockrig.analysis.flight.simulated.sensor import fly
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import inversion
from shockrig.files.profile import write_profile
from shockrig.protocols.cli import main as shockrig

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from test_flight_forms import write_bin

KEYS = {  # of BUFR -> of our file, and the step in which BUFR writes it
    "airTemperature": ("air_temperature", 0.01),
    "relativeHumidity": ("relative_humidity", 0.01),
    "mixingRatio": ("humidity_mixing_ratio", 1e-10),
    "pressure": ("air_pressure", 10.0),
    "latitude": ("lat", 1e-5),
    "longitude": ("lon", 1e-5),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--converter", type=Path, required=True)
    args = parser.parse_args()
    spec = importlib.util.spec_from_file_location("uas2bufr", args.converter)
    converter = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(converter)
    import eccodes

    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        profile = typical_profile()
        write_profile(profile, home / "profile.json")
        write_bin(home / "flight.bin", fly(inversion(np.random.default_rng(0)), profile, 3).log)
        command = ["correct", str(home / "flight.bin"), "--profile", str(home / "profile.json"), "--out", str(home)]
        shockrig([*command, "--wmo", "007:ABC12"])
        path = next(home.glob("UASDC_*.nc"))
        converter.validate_filename(str(path))
        print(f"name taken: {path.name}")
        with contextlib.redirect_stdout(io.StringIO()) as said:
            converter.uas2bufr(str(path), str(home / "flight.bufr"))
        warnings = [line for line in said.getvalue().splitlines() if line.startswith("Warning")]
        with (home / "flight.bufr").open("rb") as stream:
            message = eccodes.codes_bufr_new_from_file(stream)
            eccodes.codes_set(message, "unpack", 1)
            rows = eccodes.codes_get(message, "numberOfSubsets")
            print(f"converted: {rows} rows, {(home / 'flight.bufr').stat().st_size} bytes of BUFR")
            print(f"said to be missing, all of them optional: {', '.join(w.split()[1] for w in warnings)}")
            worst = 0.0
            with netCDF4.Dataset(path) as data:
                for key, (name, step) in KEYS.items():
                    back = np.asarray(eccodes.codes_get_array(message, key), dtype=float)
                    ours = np.ma.filled(data[name][:], np.nan)
                    off = float(np.max(np.abs(np.broadcast_to(back, ours.shape) - ours)))
                    worst = max(worst, off / step)
                    print(f"  {key:<20} differs from {name} by at most {off:.3g}; BUFR's step is {step:g}")
    print("every value survives to within BUFR's own step" if worst <= 1.0 else "VALUES DIFFER")
    return 0 if worst <= 1.0 else 1


if __name__ == "__main__":
    sys.exit(main())
