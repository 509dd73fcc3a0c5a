"""When unused objects are looked for, in processes whose threads must not be held up."""

from __future__ import annotations

import gc
import weakref

from stickslip.rig.memory import collect, collected_on_request


class Circle:
    """It holds itself: only a collection ends it."""

    def __init__(self) -> None:
        self.other = self


def test_circles_are_collected_when_asked_and_no_whole_collection_comes_by_itself() -> None:
    before, whole = gc.get_threshold(), []

    def seen(phase: str, info: dict[str, int]) -> None:
        if phase == "stop" and info["generation"] == 2:
            whole.append(info)

    gc.callbacks.append(seen)
    try:
        with collected_on_request():
            kept = [[i] for i in range(400_000)]  # by itself it would look through all of them
            assert not whole
            gone = weakref.ref(Circle())
            collect()
            assert gone() is None
            assert len(whole) == 1
            assert gc.get_freeze_count() > len(kept), "they are not looked at again"
            later = weakref.ref(Circle())
            collect()
            assert later() is None
    finally:
        gc.callbacks.remove(seen)
    assert gc.get_threshold() == before
    assert gc.get_freeze_count() == 0
