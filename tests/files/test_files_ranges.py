"""One plausible range for each quantity: every door takes what the table takes and refuses what it refuses."""

import ast
import json
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from shockrig.files.campaign import read_campaign
from shockrig.files.common_uncertainty import INPUTS
from shockrig.files.errors import InputError
from shockrig.files.profile import profile_from_document
from shockrig.files.ranges import MATERIALS, RANGES
from shockrig.protocols.cli import main
from shockrig.protocols.flight_world import read_flown_air
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.bench_file import load_bench
from shockrig.rig.protocol import parse_protocol

ROOT = Path(__file__).parents[2]


def campaign_with(folder, run=None, sensors=None, air=None):
    (folder / "runs/0001").mkdir(parents=True)
    (folder / "campaign.json").write_text(json.dumps({"format": "shock-campaign/1", "sensors": sensors or {}}))
    (folder / "runs/0001/run.json").write_text(json.dumps({"format": "shock-run/1", **(run or {})}))
    if air is not None:
        (folder / "runs/0001/air.csv").write_text(air)
    return read_campaign(folder).runs[0]


def nested(key, value):
    """{"a": {"b": value}} of "a.b"."""
    for name in reversed(key.split(".")):
        value = {name: value}
    return value


def of_run(key):
    return lambda folder, value: campaign_with(folder, run=nested(key, value))


def of_sensor(key):
    return lambda folder, value: campaign_with(folder, sensors=nested(key, value))


def of_common(key):
    def read(folder, value):
        (folder / "runs/0001").mkdir(parents=True)
        (folder / "runs/0001/run.json").write_text('{"format": "shock-run/1"}')
        head = {"format": "shock-campaign/1", "common_uncertainty": {key: value}}
        (folder / "campaign.json").write_text(json.dumps(head))
        assert getattr(read_campaign(folder).common, key) == value

    return read


def of_air(column):
    def read(folder, value):
        run = campaign_with(folder, air=f"time_s,{column}\n0,{value!r}\n1,{value!r}\n")
        assert run.air.values[column].tolist() == [value] * 2

    return read


def of_trace(file, column):
    def read(folder, value):
        (folder / "runs/0001").mkdir(parents=True)
        (folder / f"runs/0001/{file}").write_text(f"time_s,{column}\n0,{value!r}\n")
        (folder / "campaign.json").write_text('{"format": "shock-campaign/1"}')
        (folder / "runs/0001/run.json").write_text('{"format": "shock-run/1"}')
        trace = getattr(read_campaign(folder).runs[0], file.removesuffix(".csv"))
        if trace.dropped == {"implausible": 1}:
            raise InputError("dropped")
        assert trace.values[column].tolist() == [value]

    return read


def of_course(folder, value):
    """A thermometer that goes from a room to `value` by itself."""
    rows = "".join(f"{k},{20.0 + (value - 20.0) * k / 11!r}\n" for k in range(12))
    for part in ("imet.csv", "air.csv"):
        campaign_with(folder / part, air=f"time_s,temperature_c\n{rows}")
        (folder / part / "runs/0001/imet.csv").write_text(f"time_s,temperature_c\n{rows}")
        run = read_campaign(folder / part).runs[0]
        if run.imet.dropped or run.air.dropped:
            raise InputError("dropped")
        assert run.imet.values["temperature_c"][-1] == pytest.approx(value)


def of_profile(part, key):
    documents = {
        "temperature": {"thermal_diffusivity_m2_s": {"value": 1e-7}},
        "humidity": {"diffusivity_table": [{"ambient_temperature_c": 20, "diffusivity_m2_s": 1e-11}]},
    }

    def read(folder, value):
        document = json.loads(json.dumps(documents[part]))
        place = document["diffusivity_table"][0] if key in document.get("diffusivity_table", [{}])[0] else document
        place[key] = value
        profile_from_document({"format": "sensor-profile/1", part: document})

    return read


def of_import(option):
    def read(folder, value):
        (folder / "log.csv").write_text("time_s,temperature_c\n0,20\n1,21\n2,22\n")
        words = ["import", "--imet", str(folder / "log.csv"), "--out", str(folder / "c"), f"{option}={value!r}"]
        if main(words) == 2:
            raise InputError("refused")

    return read


PROTOCOL = """format = "shock-protocol/1"
airflow_m_s = 5.0
[steps]
usual = [{ do = "soak", over_s = 10 }, { do = "record", for_s = 10 }, { do = "transfer" }, { do = "record", for_s = 9 }]
[[run]]
source = { temperature_c = 19.0, humidity_percent = 31.0 }
destination = { temperature_c = 21.0, humidity_percent = 80.0 }
"""


def of_protocol(before, after):
    return lambda folder, value: parse_protocol(PROTOCOL.replace(before, f"{after} = {value!r}").encode(), "p.toml")


def of_bench(folder, value):
    text = (ROOT / "data/benches/virtual.toml").read_text()
    assert "pressure_hpa" in text
    lines = [f"pressure_hpa = {value!r}" if "pressure_hpa" in line else line for line in text.splitlines()]
    (folder / "bench.toml").write_text("\n".join(lines))
    load_bench(folder / "bench.toml")


def of_bench_light(folder, value):
    text = (ROOT / "data/benches/virtual.toml").read_text()
    (folder / "bench.toml").write_text(text.replace("[bench]", f"[bench]\nirradiances_w_m2 = [{value!r}]"))
    load_bench(folder / "bench.toml")


def of_flown_air(column):
    def read(folder, value):
        others = {"temperature_c": 20.0, "humidity_percent": 50.0} | {column: value}
        row = ",".join(repr(other) for other in others.values())
        (folder / "flight.csv").write_text(f"time_s,{','.join(others)}\n0,{row}\n1,{row}\n2,{row}\n")
        read_flown_air(folder / "flight.csv")

    return read


DOORS = {
    "temperature_c": {
        "run.json": of_run("source.temperature_c"),
        "imet.csv": of_trace("imet.csv", "temperature_c"),
        "air.csv": of_air("temperature_c"),
        "profile": of_profile("humidity", "ambient_temperature_c"),
        "import": of_import("--source-temperature"),
        "protocol": of_protocol("temperature_c = 19.0", "temperature_c"),
        "flight": of_flown_air("temperature_c"),
    },
    "temperature_reading_c": {"imet.csv and air.csv": of_course},
    "humidity_percent": {
        "run.json": of_run("destination.humidity_percent"),
        "air.csv": of_air("humidity_percent"),
        "import": of_import("--destination-humidity"),
    },
    "humidity_reading_percent": {"hyt.csv": of_trace("hyt.csv", "humidity_percent")},
    "humidity_set_percent": {
        "protocol": of_protocol("humidity_percent = 31.0", "humidity_percent"),
        "flight": of_flown_air("humidity_percent"),
    },
    "airflow_m_s": {
        "run.json": of_run("airflow_m_s"),
        "air.csv": of_air("airflow_m_s"),
        "import": of_import("--airflow"),
        "protocol": of_protocol("airflow_m_s = 5.0", "airflow_m_s"),
        "flight": of_flown_air("airspeed_m_s"),
    },
    "pressure_hpa": {
        "run.json": of_run("pressure_hpa"),
        "air.csv": of_air("pressure_hpa"),
        "import": of_import("--pressure"),
        "bench": of_bench,
        "flight": of_flown_air("pressure_hpa"),
    },
    "irradiance_w_m2": {
        "protocol": of_protocol("[[run]]", "[[run]]\nirradiance_w_m2"),
        "bench": of_bench_light,
    },
    "bead_radius_m": {
        "campaign.json": of_sensor("imet.bead_radius_m"),
        "profile": of_profile("temperature", "bead_radius_m"),
        "import": of_import("--bead-radius"),
    },
    "film_thickness_m": {
        "campaign.json": of_sensor("hyt.film_thickness_m"),
        "profile": of_profile("humidity", "film_thickness_m"),
        "import": of_import("--film-thickness"),
    },
    "time_s": {"run.json": of_run("transfer.start_s")},
    "transfer_s": {"run.json": of_run("transfer.duration_s"), "import": of_import("--duration")},
    "reference_time_constant_s": {"run.json": of_run("reference.humidity_time_constant_s")},
    "reference_uncertainty_k": {"run.json": of_run("reference.temperature_standard_uncertainty_k")},
    "reference_uncertainty_percent": {"run.json": of_run("reference.humidity_standard_uncertainty_percent")},
    **{f"common_{key}": {"campaign.json": of_common(key)} for key in INPUTS},
    "step_s": {"protocol": of_protocol("for_s = 9", "for_s")},
    "tolerance_k": {"protocol": of_protocol("over_s = 10", "probes_within_k")},
    "tolerance_percent": {"protocol": of_protocol("over_s = 10", "reference_within_percent")},
    "fitted_m2_s": {"profile": of_profile("humidity", "diffusivity_m2_s")},
    "noise_k": {"profile": of_profile("temperature", "noise_k")},
    "noise_percent": {"profile": of_profile("humidity", "noise_percent")},
    "sampling_period_s": {"profile": of_profile("temperature", "sampling_period_s")},
}
POSITIVE = ("step_s", "tolerance_k", "tolerance_percent")  # a step that takes no time is none


@pytest.mark.parametrize(("quantity", "door"), [(q, door) for q, doors in DOORS.items() for door in doors])
def test_every_door_takes_what_the_table_takes_and_nothing_else(tmp_path, capsys, quantity, door):
    possible, read = RANGES[quantity], DOORS[quantity][door]
    inside = [float(possible.high), 0.5 * (possible.low + possible.high)]
    inside += [] if quantity in POSITIVE else [float(possible.low)]
    width = possible.high - possible.low
    for number, value in enumerate(inside):
        folder = tmp_path / f"inside{number}"
        folder.mkdir()
        read(folder, value)
    for number, value in enumerate((possible.low - 1e-3 * width, possible.high + 1e-3 * width)):
        folder = tmp_path / f"outside{number}"
        folder.mkdir()
        with pytest.raises((InputError, BenchError)):
            read(folder, value)


def test_every_row_of_the_table_is_tried():
    assert set(DOORS) == set(RANGES) - {"rate_hz"}  # of an emulated instrument: test_emulate asks that door


def limits_written_out(file):
    """(line, name) of pairs of numbers, low and high, that carry the name of a quantity with its unit."""
    units = ("_c", "_k", "_m_s", "_hpa", "_percent", "_m", "airflow", "pressure", "temperature", "humidity", "radius")
    for node in ast.walk(ast.parse(file.read_text())):
        named = []
        if isinstance(node, ast.Dict):
            named = [
                (key.value, value)
                for key, value in zip(node.keys, node.values, strict=True)
                if isinstance(key, ast.Constant)
            ]
        elif isinstance(node, ast.Assign):
            named = [(target.id, node.value) for target in node.targets if isinstance(target, ast.Name)]
        elif isinstance(node, ast.keyword):
            named = [(node.arg, node.value)]
        for name, value in named:
            if isinstance(value, ast.Call) and getattr(value.func, "id", "") == "Range":
                value = ast.Tuple(value.args[:2])
            if not isinstance(value, ast.Tuple) or len(value.elts) != 2 or not isinstance(name, str):
                continue
            try:
                low, high = (ast.literal_eval(element) for element in value.elts)
            except ValueError:
                continue
            if isinstance(low, int | float) and isinstance(high, int | float) and low < high:
                if name.lower().endswith(units):
                    yield node.value.lineno if hasattr(node, "value") else node.lineno, name


# Not what a quantity can be: what one instrument can say, a scale and an offset, what is drawn at random.
OTHER = ("rig/sensors/", "rig/scan.py", "rig/virtual/", "files/unit_names.py")


def test_no_other_table_of_ranges_is_written_out():
    found = [
        f"{file.relative_to(ROOT)}:{line} {name}"
        for top in ("files", "rig", "protocols")
        for file in sorted((ROOT / top).rglob("*.py"))
        if not str(file.relative_to(ROOT)).startswith((*OTHER, "files/ranges.py"))
        for line, name in limits_written_out(file)
    ]
    assert [place for place in found if "_UNITS" not in place] == []


def test_the_search_for_other_tables_finds_one(tmp_path):
    (tmp_path / "a.py").write_text(
        'AIRFLOWS_M_S = (0.0, 340.0)\nLIMITS = {"pressure": (1, 1200), "x": (1, 2)}\nread(temperature_c=Range(-9, 9))\n'
    )
    assert [name for _, name in limits_written_out(tmp_path / "a.py")] == ["AIRFLOWS_M_S", "pressure", "temperature_c"]


def test_the_schemas_state_the_same_ranges():
    folder = resources.files("shockrig.data") / "schemas"

    def properties(name):
        return json.loads((folder / f"{name}.json").read_text())["properties"]

    def stated(schema):
        return schema["minimum"], schema["maximum"]

    def row(name):
        return RANGES[name].low, RANGES[name].high

    run = properties("shock-run-1")
    for air in ("source", "destination"):
        for name in ("temperature_c", "humidity_percent"):
            assert stated(run[air]["properties"][name]) == row(name)
    for name in ("airflow_m_s", "pressure_hpa"):
        assert stated(run[name]) == row(name)
    assert stated(run["transfer"]["properties"]["start_s"]) == row("time_s")
    assert stated(run["transfer"]["properties"]["duration_s"]) == row("transfer_s")
    reference = run["reference"]["properties"]
    assert {name: stated(reference[name]) for name in reference} == {
        "temperature_time_constant_s": row("reference_time_constant_s"),
        "temperature_standard_uncertainty_k": row("reference_uncertainty_k"),
        "humidity_time_constant_s": row("reference_time_constant_s"),
        "humidity_standard_uncertainty_percent": row("reference_uncertainty_percent"),
    }
    for name in ("shock-campaign-1", "sensor-profile-1"):
        sensors = properties(name)["sensors"]["properties"]
        assert stated(sensors["imet"]["properties"]["bead_radius_m"]) == row("bead_radius_m")
        assert stated(sensors["hyt"]["properties"]["film_thickness_m"]) == row("film_thickness_m")


def test_a_slip_of_the_unit_is_refused_with_what_it_may_be(tmp_path):
    """A kelvin for a degree Celsius, a pascal for a hectopascal, a millimetre for a metre: the usual slips."""
    for key, value, words in (
        ("source.temperature_c", 293.15, "is it in kelvin or fahrenheit"),
        ("pressure_hpa", 101325.0, "is it in pascal"),
        ("transfer.duration_s", 40000.0, "is it in milliseconds"),
        ("transfer.start_s", 1.7e9, "since 1970"),
    ):
        with pytest.raises(InputError, match=words):
            campaign_with(tmp_path / key, run=nested(key, value))
    with pytest.raises(InputError, match=r"sensors\.imet\.bead_radius_m: 0\.4 cannot be.*is it in millimetres"):
        campaign_with(tmp_path / "radius", sensors={"imet": {"bead_radius_m": 0.4}})
    with pytest.raises(InputError, match=r"film_thickness_m: 10 cannot be.*millimetres or micrometres"):
        campaign_with(tmp_path / "thickness", sensors={"hyt": {"film_thickness_m": 10}})


def test_materials_hold_what_is_published_and_what_the_virtual_bench_draws():
    """Conductivity, density and heat capacity of Pyrex and copper (Incropera, Fundamentals of Heat and Mass Transfer,
    appendix A) and of Kapton (its data sheet); D of vapour in air from 0.2178 cm2/s at 0 degC (Massman 1998).
    """
    from shockrig.rig.virtual.truth import draw_truth

    solids = {"pyrex": (1.4, 2225.0, 835.0), "copper": (401.0, 8933.0, 385.0), "kapton": (0.12, 1420.0, 1090.0)}
    for conductivity, density, heat_capacity in solids.values():
        assert MATERIALS["thermal_diffusivity_m2_s"].holds(conductivity / (density * heat_capacity))
    assert all(MATERIALS["diffusivity_m2_s"].holds(0.2178e-4 * ((t + 273.15) / 273.15) ** 1.81) for t in (-40.0, 40.0))
    for seed in range(100):
        truth = draw_truth(np.random.default_rng(seed), "rough")
        assert MATERIALS["thermal_diffusivity_m2_s"].holds(truth.thermal_diffusivity_m2_s)
        assert all(MATERIALS["diffusivity_m2_s"].holds(float(truth.diffusivity_m2_s(t))) for t in (-20.0, 60.0))
    assert not MATERIALS["thermal_diffusivity_m2_s"].holds(0.065)  # a radius in millimetres taken as metres
