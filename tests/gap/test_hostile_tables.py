"""Malformed tables of a campaign: each is refused by file and place, or read right, soon and in little memory."""

import re
import resource
import signal
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.gap.show.campaign import campaign_json
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.table import MOST_BYTES

pytestmark = pytest.mark.slow

openpyxl = pytest.importorskip("openpyxl")
COLUMNS = ("x", "y", "z", "quantity", "value", "sigma")
ROW = (0, 0, 0.35, "ez", 1e-5, 1e-6)
SECONDS = 10
NAMESPACE = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"


def load(folder, name):
    (folder / "campaign.toml").write_text(f'robot = "biglide"\nreadings = "{name}"\n')
    return load_campaign(folder)


@pytest.fixture(autouse=True)
def _bounded():
    """An alarm after ten seconds of the processor, and two gigabytes more than is in use."""

    def late(*_):
        raise TimeoutError(f"no answer within {SECONDS} s")

    before = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + (2 << 30), before[1]))
    signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    yield
    signal.setitimer(signal.ITIMER_PROF, 0)
    resource.setrlimit(resource.RLIMIT_AS, before)


def workbook(folder, *sheets):
    """A workbook of sheets (title, state, rows); a row is a list of cells or a dict of cells by name."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, state, rows in sheets:
        sheet = book.create_sheet(title)
        sheet.sheet_state = state
        for row in rows:
            if isinstance(row, dict):
                for place, value in row.items():
                    sheet[place] = value
            else:
                sheet.append(row)
    book.save(folder / "r.xlsx")


def rewritten(folder, sheet):
    """The workbook with another text of its first sheet."""
    with zipfile.ZipFile(folder / "r.xlsx") as book:
        content = {name: book.read(name) for name in book.namelist()}
    content["xl/worksheets/sheet1.xml"] = sheet.encode()
    with zipfile.ZipFile(folder / "r.xlsx", "w", zipfile.ZIP_DEFLATED) as book:
        for name, data in content.items():
            book.writestr(name, data)


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        (
            "XFD1048576",
            r"r.xlsx:1048576: column 16384: expected 6 cells, got .1. to the right of them",
        ),
        ("XFD1", r"r.xlsx:1: column 1001: expected at most 1,000 columns"),
        (
            "XFD3",
            r"r.xlsx:3: column 16384: expected 6 cells, got .1. to the right of them",
        ),
        ("A1048576", r"r.xlsx:1048576: quantity: expected"),
        ("G3", r"r.xlsx:3: column 7: expected 6 cells, got .1. to"),
    ],
)
def test_a_far_off_cell_is_named(tmp_path, place, expected):
    workbook(tmp_path, ("one", "visible", [COLUMNS, ROW, {place: 1}]))
    with pytest.raises(InputError, match=expected):
        load(tmp_path, "r.xlsx")


def test_a_hidden_sheet_is_not_read(tmp_path):
    old = [*ROW[:4], 7e-5, 1e-6]
    workbook(
        tmp_path, ("old", "hidden", [COLUMNS, old]), ("new", "visible", [COLUMNS, ROW])
    )
    assert load(tmp_path, "r.xlsx").value.tolist() == [1e-5]
    (tmp_path / "r.xlsx").unlink()
    workbook(tmp_path, ("a", "visible", []), ("b", "veryHidden", [COLUMNS, ROW]))
    with pytest.raises(InputError, match=r"r\.xlsx: expected a header line"):
        load(tmp_path, "r.xlsx")


def test_a_second_sheet_is_told(tmp_path, caplog):
    old = [*ROW[:4], 7e-5, 1e-6]
    workbook(
        tmp_path, ("old", "visible", [COLUMNS, old]), ("new", "visible", [COLUMNS, ROW])
    )
    assert load(tmp_path, "r.xlsx").value.tolist() == [7e-5]
    assert "r.xlsx: sheet 'old' is read, not 'new'" in caplog.text
    caplog.clear()
    workbook(tmp_path, ("empty", "visible", []), ("new", "visible", [COLUMNS, ROW]))
    with pytest.raises(
        InputError, match=r"^r\.xlsx \(sheet 'empty'\): expected a header line"
    ):
        load(tmp_path, "r.xlsx")
    assert not caplog.text  # a refusal is one line


def test_a_formula_without_its_value_is_refused(tmp_path):
    workbook(
        tmp_path,
        ("one", "visible", [COLUMNS, ROW, [*ROW[:4], 2e-5, None], {"F3": "=E3/10"}]),
    )
    with pytest.raises(
        InputError,
        match=r"^r.xlsx:3: column 6: expected a formula with its value, got none; open the",
    ):
        load(tmp_path, "r.xlsx")
    with zipfile.ZipFile(tmp_path / "r.xlsx") as book:
        sheet = book.read("xl/worksheets/sheet1.xml").decode()
    rewritten(tmp_path, re.sub(r"(</f>)(<v\s*/>|<v></v>)?", r"\1<v>2e-6</v>", sheet))
    assert load(tmp_path, "r.xlsx").sigma.tolist() == [1e-6, 2e-6]


def _sheet_of(rows, dimension="A1:F2"):
    return f'<worksheet xmlns="{NAMESPACE}"><dimension ref="{dimension}"/><sheetData>{rows}</sheetData></worksheet>'


WIDE = '<row r="{0}"><c r="XFD{0}"/></row>'
SHEETS = {
    "a lying dimension": _sheet_of(
        '<row r="1"><c r="A1" t="inlineStr"><is><t>x</t></is></c></row>',
        "A1:XFD1048576",
    ),
    "a row without end": _sheet_of(
        '<row r="999999999999"><c r="A9"><v>1</v></c></row>'
    ),
    "a negative row": _sheet_of('<row r="-5"><c r="A1"><v>1</v></c></row>'),
    "rows backwards": _sheet_of(
        '<row r="5"><c r="A5"><v>1</v></c></row><row r="1"><c r="A1"><v>1</v></c></row>'
    ),
    "a column beyond the last": _sheet_of('<row r="1"><c r="ZZZZ1"><v>1</v></c></row>'),
    "wide empty rows": _sheet_of("".join(WIDE.format(k) for k in range(1, 100_000))),
    "no rows": _sheet_of(""),
    "no such string": _sheet_of('<row r="1"><c r="A1" t="s"><v>99</v></c></row>'),
    "an error in a cell": _sheet_of(
        '<row r="1"><c r="A1" t="e"><v>#REF!</v></c></row>'
    ),
    "an entity": f'<!DOCTYPE w [<!ENTITY a "b">]>{_sheet_of("<row>&a;</row>")}',
    "no XML": "nothing",
    "an end too early": _sheet_of("")[:-30],
    "deep": _sheet_of("<row>" * 20_000 + "</row>" * 20_000),
    "another root": f'<chartsheet xmlns="{NAMESPACE}"/>',
    "many empty rows": _sheet_of("<row/>" * 1_100_000),
}


@pytest.mark.extended_for("many empty rows")
@pytest.mark.parametrize("name", SHEETS)
def test_a_malformed_sheet_is_refused(tmp_path, name):
    workbook(tmp_path, ("one", "visible", [COLUMNS, ROW]))
    rewritten(tmp_path, SHEETS[name])
    with pytest.raises(InputError, match=r"^.*r\.xlsx"):
        load(tmp_path, "r.xlsx")


@pytest.mark.parametrize(
    "row",
    [
        "<row>" + "<c/>" * 10_000_000,
        "<row" + "".join(f" a{k}=''" for k in range(99_999)),
    ],
)
def test_a_row_that_takes_minutes_to_read_is_refused(tmp_path, row):
    workbook(tmp_path, ("one", "visible", [COLUMNS, ROW]))
    rewritten(tmp_path, _sheet_of(row))
    with pytest.raises(
        InputError,
        match=r"r\.xlsx: expected .* 524,288 tags .*, got more in 'xl/worksheets",
    ):
        load(tmp_path, "r.xlsx")


HEADER = ",".join(COLUMNS)
LINE = ",".join(map(str, ROW))
TEXTS = {
    "only newlines": b"\n" * (MOST_BYTES - 1),
    "a header and newlines": HEADER.encode() + b"\n" * (MOST_BYTES - 100),
    "only carriage returns": b"\r" * (MOST_BYTES // 8),
    "only separators": b"," * (MOST_BYTES // 4),
    "only semicolons": (b";" * 1000 + b"\n") * (MOST_BYTES // 4004),
    "too large": b"," * (MOST_BYTES + 1),
    "one long cell": b"x" * (MOST_BYTES - 1),
    "one long quoted cell": b'"' + b"x" * (1 << 20),
    "quotes": b'"' * 1_000_001,
    "many columns": b",".join(b"c%d" % k for k in range(500_000)),
    "many rows of one cell": HEADER.encode() + b"\n1" * 10_000_000,
    "a long row": HEADER.encode() + b"\n" + b"1," * 1_000_000,
    "zeros": b"\0" * 1000,
    "UTF-16": f"{HEADER}\n{LINE}\n".encode("utf-16"),
    "a picture": b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 100,
    "a workbook by another name": b"PK\x03\x04" + bytes(range(256)),
    "a line of blanks": b" " * 1_000_000,
    "blanks and newlines": b" \n" * 10_000_000,
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_malformed_text_is_refused(tmp_path, name):
    (tmp_path / "r.csv").write_bytes(TEXTS[name])
    with pytest.raises(InputError, match=r"^(.*/)?r\.csv"):
        load(tmp_path, "r.csv")


CELLS = {
    "x": [
        "",
        "nan",
        "inf",
        "-inf",
        "1e999",
        "0x10",
        "1_0",
        "1.0.0",
        "+-1",
        "--",
        "1e5",
        "0 0",
        "=A1",
        "'0",
    ],
    "quantity": [
        "",
        "EZ",
        "e z",
        "ezz",
        "f0",
        "f31",
        "f",
        "f1.0",
        "f-1",
        "d",
        "dx;",
        "smr.x",
        "=1",
    ],
    "value": [
        "",
        "nan",
        "inf",
        "1e308",
        "1e-5 m",
        "1e-5m",
        "10um",
        "1e-5;",
        "\u0661",
        "\uff11",
        "true",
        "None",
        "#N/A",
        "#REF!",
        "-",
    ],
    "sigma": [
        "0",
        "-1e-6",
        "nan",
        "inf",
        "1e-400",
        "1e-15",
        "11",
        "1e-6 m",
        "±1e-6",
        "?",
        "1E",
        "e-6",
        "0.0",
    ],
}


@pytest.mark.parametrize(
    ("column", "cell"), [(c, cell) for c, cells in CELLS.items() for cell in cells]
)
def test_a_malformed_cell_is_named(tmp_path, column, cell):
    row = [
        cell if name == column else str(value)
        for name, value in zip(COLUMNS, ROW, strict=True)
    ]
    (tmp_path / "r.csv").write_text("\t".join(COLUMNS) + "\n" + "\t".join(row) + "\n")
    with pytest.raises(InputError, match=rf"^r\.csv:2: {column}: expected "):
        load(tmp_path, "r.csv")


@pytest.mark.parametrize(
    ("rows", "place"),
    [
        (("1.000;4,2;a", "900;3,9;a"), "2: fx"),  # thousands as Germans write them
        (("900;4.2;a", "1,000;3.9;a"), "3: fx"),  # and as the English do
        (("900;987,5;a", "900;1.234;a"), "3: value"),
        (("900;4,2;1.234", "900;2,345;1.1"), ""),  # labels are no numbers
        (("900;0.125;a", "900;1.234;a"), ""),
    ],
)
def test_a_separator_of_thousands_is_not_a_decimal_mark(tmp_path, rows, place):
    lines = [
        "x;y;z;quantity;sigma;fx;value;session",
        *(f"0;0;0;dx;;{row}" for row in rows),
    ]
    (tmp_path / "r.csv").write_text("\n".join(lines))
    if not place:
        assert len(load(tmp_path, "r.csv")) == 2
        return
    with pytest.raises(
        InputError,
        match=rf"^r\.csv:{place}: expected one decimal mark, as in .*, and no separator of",
    ):
        load(tmp_path, "r.csv")


@pytest.mark.parametrize(
    ("text", "other", "taken"),
    [
        *(
            ("1,000", "4,25", True),
            ("1,000", "0,125", True),
            ("1,000", "1,234", False),
            ("1,000", 4.25, False),
        ),
        *(("1.000", "4,25", False), ("1.000", 4.25, True), (1.125, "4,25", True)),
    ],
)
def test_a_text_of_a_workbook_has_no_separator_of_thousands(
    tmp_path, text, other, taken
):
    """A comma in three digits is decimal only beside one that cannot be anything else, a point beside none."""
    book = openpyxl.Workbook()
    for row in (
        ["x", "y", "z", "quantity", "value", "sigma"],
        [0, 0, 0, "ez", text, 1e-6],
        [0, 0, 0, "ez", other, 1e-6],
    ):
        book.active.append(row)
    book.save(tmp_path / "r.xlsx")
    if taken:
        assert load(tmp_path, "r.xlsx").value[0] == float(str(text).replace(",", "."))
        return
    with pytest.raises(
        InputError,
        match=r"^r\.xlsx:2: value: expected .* and no separator of thousands, got",
    ):
        load(tmp_path, "r.xlsx")


def test_rows_of_separators_are_skipped_and_labels_keep_their_commas(tmp_path):
    (tmp_path / "r.csv").write_text(f"{HEADER}\n{LINE}\n,,,,,\n,,,,,\n")
    assert len(load(tmp_path, "r.csv")) == 1
    (tmp_path / "r.csv").write_text(
        "x;y;z;quantity;value;sigma;session\n0;0;0,35;ez;1e-5;1e-6;1,5\n"
    )
    assert load(tmp_path, "r.csv").session_names == ("1,5",)


def test_as_many_sessions_as_readings_are_counted_in_time(tmp_path):
    (tmp_path / "r.csv").write_text(f"{HEADER}\n{LINE}\n")
    count = 120_000
    many = load(tmp_path, "r.csv").select(np.zeros(count, dtype=int))
    many = replace(
        many, session=np.arange(count), session_names=tuple(map(str, range(count)))
    )
    assert set(campaign_json(many)["sessions"].values()) == {1}


@pytest.mark.parametrize("count", [1000, 1001])
def test_more_unknown_zeros_than_ten_seconds_can_fit_are_refused(tmp_path, count):
    text = "x,y,z,sensor,value,sigma,session\n" + (
        "\n".join(f"0,0,0.35,gauge,1e-5,1e-6,{k % count}" for k in range(20_000))
    )
    (tmp_path / "r.csv").write_text(text)
    sensor = '[sensors.gauge]\nmeasures = "displacement"\nbody = "platform"\nat = [0, 0, 0.3]\ndirection = [0, 0, 1]\n'
    (tmp_path / "campaign.toml").write_text(
        f'robot = "delta"\nreadings = "r.csv"\n{sensor}zero = "session"\n'
    )
    if count == 1000:
        assert len(load_campaign(tmp_path, load_robot("delta"))) == 20_000
        return
    with pytest.raises(
        InputError,
        match=r"^r\.csv:1002: session: expected at most 1,000 sessions, each",
    ):
        load_campaign(tmp_path, load_robot("delta"))
