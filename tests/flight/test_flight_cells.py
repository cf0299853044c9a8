"""The rows of a log read by compiled code are those that the csv module and Python's float() give."""

import numpy as np
import pytest

from shockrig.files import flight_cells
from shockrig.files.errors import InputError
from shockrig.files.flight import read_layout
from shockrig.files.flight_cells import joined, numbers_of, plain_numbers, read_blocks
from shockrig.files.flight_rows import look_over, to_flight
from shockrig.rig.logs.log import Column, read_rows
from shockrig.rig.logs.text import Layout

HEADER = "time_s,temperature_c,humidity_percent,note\n"
PLAIN = "".join(f"{k / 10},{20 - k / 9},{40 + k / 7:.5f},a\n" for k in range(12))
ODD = {
    "plain": PLAIN,
    "Windows": PLAIN.replace("\n", "\r\n"),
    "no end": PLAIN.rstrip("\n"),
    "Macintosh": PLAIN.replace("\n", "\r"),
    "one lone return": PLAIN.replace("20.0", "20.0\r", 1),
    "empty lines": PLAIN.replace("\n", "\n\n") + "\n\n",
    "blanks": PLAIN.replace("20.0", " 20.0 ").replace("0.3,", " ,"),
    "short rows": PLAIN + "1.2,19\n1.3\n" + PLAIN,
    "quotes": PLAIN + '1.2,"19.5",50,"a, b"\n' + PLAIN,
    "lines in quotes": PLAIN + '1.2,19.5,50,"a\nb"\n' + PLAIN,
    "a quote within": PLAIN + '1.2,19.5,50,a"b\n',
    "NUL": PLAIN + "\0\0\0\n" + PLAIN.replace("19.6", "1\x009.6"),
    "no reading": PLAIN + "1.2,,50,\n1.3,n/a,nan,x\n1.4,inf,-,y\n1.5,text,51,z\n",
    "not ASCII": PLAIN + "1.2,19.5,50,20 °C\n" + PLAIN,
    "digits": "".join(f"{k},{v},{v}e{k},\n" for k, v in enumerate(("1" * 14, "9" * 16, "0." + "7" * 30, "-.5", "5.")))
    + "7,1e400,-1E-400,\n8,1_0,0x10,\n9,1e,1e+5,\n10,-0,1.2.3,\n11," + "1" * 90 + ",2,\n",
    "long line": PLAIN + "1.2,19.5,50," + "a" * 110_000 + "\n" + PLAIN,
    "nothing": "",
}  # fmt: skip
SPOILT = {"too long a row": "1.2,19.5,50,a,b\n", "too long a cell": "1.2,19.5,50," + "a" * 140_000 + "\n"}


def log(path, content, mark=b""):
    path.write_bytes(mark + (HEADER + content).encode("latin-1" if "°" in content else "utf-8"))
    return path, read_layout(path)


def read(path, layout, rows):
    blocks = list(read_blocks(path, layout, rows))
    assert all(len(block) == rows for block in blocks[:-1])
    return joined(blocks) if blocks else None


@pytest.mark.skipif(flight_cells._cells is None, reason="the kernel was not built")
@pytest.mark.parametrize("rows", [5, 100])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("case", ODD)
def test_compiled_reading_gives_what_csv_gives(tmp_path, monkeypatch, case, mark, rows):
    path, layout = log(tmp_path / "log.csv", ODD[case], mark)
    monkeypatch.setattr(flight_cells, "CHUNK", 150)
    fast, damage = read(path, layout, rows), look_over(path, layout)
    monkeypatch.setattr(flight_cells, "_cells", None)
    slow = read(path, layout, rows)
    assert damage == look_over(path, layout)
    if slow is None:
        assert fast is None
        return
    assert fast.table() == slow.table()
    assert fast.line.tolist() == slow.line.tolist() and fast.size.tolist() == slow.size.tolist()
    for place, values in slow.numbers.items():
        np.testing.assert_array_equal(fast.numbers[place], values)
    np.testing.assert_array_equal(to_flight(fast, layout).temperature_c, to_flight(slow, layout).temperature_c)


def test_underscores_between_digits_are_no_number():
    np.testing.assert_array_equal(numbers_of(["1_0", "2024_3_27_11_34_7", "5"]), [np.nan, np.nan, 5.0])


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("case", SPOILT)
def test_a_line_that_cannot_be_read_is_named(tmp_path, monkeypatch, case, compiled):
    if not compiled:
        monkeypatch.setattr(flight_cells, "_cells", None)
    path, layout = log(tmp_path / "log.csv", PLAIN + SPOILT[case] + PLAIN)
    with pytest.raises(InputError, match="line 14: "):
        list(read_blocks(path, layout, 4))


@pytest.mark.skipif(flight_cells._cells is None, reason="the kernel was not built")
def test_numbers_are_those_of_python_to_the_last_bit(tmp_path):
    rng = np.random.default_rng(1)
    exact = rng.standard_normal(2000) * 10.0 ** rng.integers(-30, 30, 2000)
    shown = [f"{float(v):.{digits}g}" for v, digits in zip(exact, rng.integers(1, 19, 2000).tolist(), strict=True)]
    path, layout = log(tmp_path / "log.csv", "".join(f"{k},{v},50,\n" for k, v in enumerate(shown)))
    assert read(path, layout, 700).numbers[1].tolist() == [float(v) for v in shown]


@pytest.mark.skipif(flight_cells._cells is None, reason="the kernel was not built")
def test_columns_in_any_order_and_twice_of_lines_that_are_nothing_but_numbers():
    text = b"1,2,3\n4,,6\r\n"
    np.testing.assert_array_equal(plain_numbers(text, 3, [2, 0, 1, 2], 2), [[3, 6], [1, 4], [2, np.nan], [3, 6]])
    for other in (text + b"7,8\n", text + b"7,8,nan\n", text + b'7,8,"9"\n', text):
        assert plain_numbers(other, 3, [2], 3) is None


@pytest.mark.parametrize("between", ["", "# 9,9,9,9\n", "time_s,temperature_c,humidity_percent,note\n", "1.1,19\n"])
def test_a_log_of_numbers_is_imported_the_same_with_and_without_compiled_reading(tmp_path, monkeypatch, between):
    rows = [f"{k / 10},{20 - k / 9:.3f},{40 + k / 7:.3f},\n" for k in range(300)]
    path = tmp_path / "log.csv"
    path.write_text(HEADER + "".join(rows[:150]) + between + "".join(rows[150:]).rstrip("\n"))
    columns = [Column("temperature_c", "temperature", "degC"), Column("humidity_percent", "humidity", "percent")]

    def numbers():
        read = read_rows(path, Layout(), columns)
        return read.time_s, *read.values.values(), read.numbers, read.remarks

    fast = numbers()
    monkeypatch.setattr(flight_cells, "_cells", None)
    for one, other in zip(fast, numbers(), strict=True):
        np.testing.assert_array_equal(one, other)
    assert fast[0].size == 300
