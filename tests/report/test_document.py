import numpy as np
import pytest

from stickslip.report import Column, Document, DocumentError, Number, Picture, Section, Table

SVG = '<svg xmlns="http://www.w3.org/2000/svg"></svg>'


@pytest.mark.parametrize("cell", [1.5, 3, np.float64(2.0), np.int64(7), float("nan")])
def test_a_number_needs_a_unit(cell: float) -> None:
    with pytest.raises(DocumentError, match=r"table 'Laws', row 2, column 'force'.*no unit"):
        Table("Laws", [Column("law"), Column("force")], [["Dahl", None], ["LuGre", cell]])
    assert Table("Laws", [Column("law"), Column("force", "N")], [["LuGre", cell]]).rows[0][1] is cell


def test_a_number_brings_its_unit_but_not_another_one() -> None:
    cell = Number(1.399e6, "N/m")
    assert Table("Laws", [Column("value")], [[cell]]).rows == ((cell,),)
    with pytest.raises(DocumentError, match="column 'value' is in 'N', but the number in it is in 'N/m'"):
        Table("Laws", [Column("value", "N")], [[cell]])


@pytest.mark.parametrize("cell", [True, [1.0], 1j])
def test_what_is_neither_number_nor_text(cell: object) -> None:
    with pytest.raises(DocumentError, match="neither a number nor text"):
        Table("Laws", [Column("value", "N")], [[cell]])  # type: ignore[list-item]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((1.0, None), "no text"),
        (("1", "N"), "no number"),
        ((True, ""), "no number"),
        ((1.0, "N", 0.9), "one end of an interval only"),
    ],
)
def test_bad_numbers(arguments: tuple, words: str) -> None:
    with pytest.raises(DocumentError, match=words):
        Number(*arguments)


@pytest.mark.parametrize(
    ("name", "alt", "svg", "words"),
    [
        ("Two words", "what it shows", SVG, "lower case"),
        ("../up", "what it shows", SVG, "lower case"),
        ("loop", " ", SVG, "what it shows"),
        ("loop", "what it shows", "<?xml version='1.0'?>", "no SVG"),
    ],
)
def test_bad_pictures(name: str, alt: str, svg: str, words: str) -> None:
    with pytest.raises(DocumentError, match=words):
        Picture(name, "caption", svg, alt)


def test_one_text_is_no_sequence_of_texts() -> None:
    with pytest.raises(DocumentError, match="section 'Friction': paragraphs"):
        Section("Friction", paragraphs="One paragraph.")
    with pytest.raises(DocumentError, match="assumptions"):
        Document("t", "s", [], assumptions="the mass")


def test_pictures_and_tables_of_all_depths_in_order() -> None:
    a, b, c = (Picture(name, "caption", SVG, "alt") for name in "abc")
    inner = Section("inner", figures=[b], tables=[Table("deep", [], [])])
    document = Document(
        "t", "s", [Section("one", figures=[a], sections=[inner]), Section("two", figures=[c])]
    )
    assert document.pictures() == (a, b, c)
    assert [table.caption for table in document.tables()] == ["deep"]
    with pytest.raises(DocumentError, match="two pictures have the name 'a'"):
        Document("t", "s", [Section("one", figures=[a]), Section("two", figures=[a])])
