import re
from dataclasses import replace

import pytest

from stickslip.report import Column, Document, Number, Section, Table
from stickslip.report.circumstances import circumstances
from stickslip.report.figures.scale import scale_for
from stickslip.report.html import number_text, report_html, significant, table_body, table_heads

from .page import Page
from .sample import sample


@pytest.fixture(scope="module")
def text() -> str:
    return report_html(sample(), circumstances("stickslip demo --out 'a b'", 12.345))


@pytest.fixture(scope="module")
def page(text: str) -> Page:
    return Page(text)


def test_needs_nothing_from_elsewhere(text: str, page: Page) -> None:
    assert not {tag for tag, _ in page.elements} & {
        "script",
        "link",
        "iframe",
        "img",
        "object",
        "embed",
        "base",
    }
    addresses = page.values("href", "src", "xlink:href", "data", "poster", "srcset", "action")
    assert addresses
    assert all(address.startswith(("#", "data:")) for address in addresses)
    assert "@import" not in text
    assert "@font-face" not in text
    assert all(target.startswith("#") for target in re.findall(r"url\(\s*['\"]?([^)]*)", text))


def test_identifiers_are_unique_and_every_link_has_its_target(page: Page) -> None:
    identifiers = page.values("id")
    assert len(identifiers) == len(set(identifiers))
    links = page.values("href", "xlink:href")
    assert {link[1:] for link in links if link.startswith("#")} <= set(identifiers)
    clips = [value for _, attrs in page.elements for value in attrs.values() if value.startswith("url(#")]
    assert clips
    assert {clip[5:-1] for clip in clips} <= set(identifiers)


def test_every_figure_has_a_number_a_caption_and_a_text_alternative(page: Page) -> None:
    figures, drawings = page.all("figure"), page.all("svg")
    assert [figure["id"] for figure in figures] == ["figure-trace", "figure-loop"]
    assert [(d["role"], d["aria-label"]) for d in drawings] == [
        ("img", 'force over "time"'),
        ("img", "a loop"),
    ]
    assert page.text["figcaption"] == ["Trace of <force>.", "Loop."]
    assert [t for t in page.text["b"] if t.startswith("Figure")] == ["Figure 1.", "Figure 2."]


def test_contents_name_all_sections(page: Page) -> None:
    for title in ("Friction loops", "Held-out part", "Thesis actuator"):
        assert title in page.text["a"]
    assert {"Assumptions", "Sources", "How this report was made"} <= set(page.text["a"])
    assert page.text["h1"] == ["Friction & piezo"]
    assert page.text["title"] == ["Friction & piezo"]
    assert page.text["h3"] == ["Held-out part"]


def test_text_of_users_is_not_markup(text: str, page: Page) -> None:
    assert "Second, with x < y." in page.text["p"]
    assert 'Laws were fitted <b>"free"</b> running.' in page.text["p"]
    assert "user's <own>" in page.text["td"]
    assert "Laws <ranked> & compared." in page.text["caption"]
    assert "fit:\n  - sigma_0 # <start>" in page.text["pre"]
    assert "<own>" not in text


def test_heads_carry_units_and_cells_the_numbers_in_them(page: Page) -> None:
    assert page.text["th"] == ["law", "parameters", "r²", "rms residual", "value"]
    units = [t for t in page.text["span"] if t in ("mN", "–")]
    assert units == ["–", "–", "mN"]
    cells = page.text["td"]
    assert cells[:4] == ["LuGre", "5", "0.99652", "25.10"]
    assert "1.399\N{NO-BREAK SPACE}MN/m" in cells
    assert "[1.380, 1.418]" in page.text["span"]
    assert "not determined" in page.text["span"]


def test_circumstances_are_told(page: Page) -> None:
    told = page.text["dd"]
    assert "12.3 s" in told
    assert page.text["code"] == ["stickslip demo --out 'a b'"]
    assert any("numpy" in line and "Python" in line for line in told)


def test_a_document_without_extras() -> None:
    bare = replace(sample(), sections=[], highlights=[], assumptions=[], citations="")
    page = Page(report_html(bare, circumstances()))
    assert page.text["a"] == ["How this report was made"]
    assert not page.all("figure")


@pytest.mark.parametrize(
    ("value", "digits", "shown"),
    [
        (0.99652, 5, "0.99652"),
        (-91234.5, 4, "−91234"),
        (0.0, 4, "0.000"),
        (1e-4, 3, "0.000100"),
        (1.2345e-7, 3, "1.23 × 10⁻⁷"),
        (-6.02e23, 3, "−6.02 × 10²³"),
        (float("nan"), 4, "–"),
        (float("-inf"), 4, "−∞"),
    ],
)
def test_digits(value: float, digits: int, shown: str) -> None:
    assert significant(value, digits) == shown


@pytest.mark.parametrize(
    ("number", "shown"),
    [
        (Number(0.1, "kg"), "0.1&nbsp;kg"),
        (Number(0.9999935, ""), "0.9999935"),
        (Number(3303.1, "rad/s"), "3303&nbsp;rad/s"),
        (Number(0.5401, "N", 0.54007, 0.54013), "540.100&nbsp;mN [540.070, 540.130]"),
        (Number(34.9, "N s/m", 0.01, 340.0), "34.90&nbsp;N s/m [0.010, 340]"),
        (Number(-2e-6, "m", -2.5e-6, -1.5e-6), "−2.000&nbsp;µm [−2.500, −1.500]"),
        (Number(5.0, "", 5.0, 5.0), "5.000 [5.0, 5.0]"),
        (Number(3.0, "m", 2.0, float("inf")), "3.000&nbsp;m [2.0, ∞]"),
        (Number(float("nan"), "m", note="no <orbit>"), "no &lt;orbit&gt;"),
    ],
)
def test_numbers_with_their_intervals(number: Number, shown: str) -> None:
    assert re.sub(r"</?span[^>]*>", "", number_text(number)) == shown


def test_a_column_has_one_prefix() -> None:
    table = Table(
        "t", [Column("gain", "m/V"), Column("law")], [[1e-7, "a"], [Number(1.2e-6, "m/V"), "b"], [None, "c"]]
    )
    assert table_heads(table) == [
        {"name": "gain", "unit": "µm/V", "numeric": True},
        {"name": "law", "unit": "", "numeric": False},
    ]
    assert [row[0] for row in table_body(table)] == [("0.1000", True), ("1.200", True), ("–", True)]
    assert scale_for("m/V", 1.2e-6).unit == "µm/V"


def test_sections_are_numbered_by_depth() -> None:
    deep = Section("a", sections=[Section("b"), Section("c", sections=[Section("d")])])
    page = Page(report_html(replace(sample(), sections=[deep]), circumstances()))
    assert page.text["h4"] == ["d"]
    assert {"section-1", "section-1.2", "section-1.2.1"} <= set(page.values("id"))


def test_a_cell_near_one_is_not_one() -> None:
    table = Table(
        "Fits.", (Column("r²", "", 5), Column("share", "%", 3)), [(0.9999989, 0.9999989), (1.0, 1.0)]
    )
    page = Page(
        report_html(
            Document("Near one", "Two rows.", sections=[Section("Fits", tables=(table,))]), circumstances()
        )
    )
    assert page.text["td"] == ["0.9999989", "1.00", "1.0000", "1.00"]
