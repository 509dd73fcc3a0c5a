"""Numbers as a terminal shows them."""

from __future__ import annotations

from stickslip.report import Number
from stickslip.report.text import shown_number


def test_numbers_with_their_intervals() -> None:
    assert shown_number(Number(0.95, "", 0.91, 0.9999935)) == "0.9500 [0.9100, 0.9999935] (95 %)"
    assert shown_number(Number(0.9999935, "")) == "0.9999935"
    assert shown_number(Number(0.5353, "N", 0.53, 0.5407)) == "535.3 mN [530.0, 540.7] (95 %)"
    assert shown_number(Number(float("nan"), "m", note="no net step")) == "no net step"
    fitted = Number(2.0, "m", 1.9, 2.1, both=(1.5, 2.5))
    assert shown_number(fitted).endswith("(95 %; with systematic errors 1.5 m to 2.5 m)")
