"""Routes of the Explore page: choices, motion, step curves and Python code of a state."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from fastapi import APIRouter, Response
from fastapi.responses import JSONResponse
from numpy.typing import ArrayLike

from ..quantities import registry
from ..quantities.units import QuantityError
from ..simulation import SimulationError
from ..simulation.varied import PIEZO
from .exploration import SliderState, mean_speed, motion, python, step_curves
from .sets import Sets
from .sliders import choices, law_types, shapes
from .stream import packed

SHOWN = (
    "time",
    "drive_voltage",
    "stage_position",
    "end_effector_position",
    "sliding_displacement",
    "friction_force",
)


def explore_routes(sets: Sets) -> APIRouter:
    """Return the router with the routes of the Explore page, below "/api/explore".

    The server keeps no state of a page: every request contains all of it. A wrong value, or a motion that
    cannot be simulated, is answered with status 422, the reason as `error`, and the `field` of the request
    that caused it.
    """
    routes = APIRouter(prefix="/api/explore")

    @routes.get("/choices")
    def offered() -> dict[str, Any]:
        return choices(sets)

    @routes.post("/motion")
    def moved(state: SliderState) -> Response:
        try:
            found = motion(state, sets)
        except (QuantityError, SimulationError) as error:
            return refused(error)
        net = float(found.end_effector_position[-1] - found.end_effector_position[0])
        numbers = {
            "net_displacement": {"value": net, "unit": found.unit},
            "mean_speed": {"value": mean_speed(state, found, sets), "unit": f"{found.unit}/s"},
        }
        header = {"loop": found.loop, "problem": found.problem, "numbers": numbers}
        return binary(header, {name: getattr(found, name) for name in SHOWN})

    @routes.post("/steps")
    def steps(state: SliderState) -> Response:
        try:
            curves = step_curves(state, sets)
        except QuantityError as error:
            return refused(error)
        return binary({}, curves)

    @routes.post("/python")
    def code(state: SliderState) -> Response:
        try:
            return JSONResponse({"code": python(state, sets)})
        except QuantityError as error:
            return refused(error)

    return routes


def binary(header: dict[str, Any], arrays: Mapping[str, ArrayLike]) -> Response:
    """Return an HTTP response with arrays by name, as float32 behind a header in JSON; see `packing.packed`.

    `header` is extended by "names", the names of the arrays in their order.
    """
    body = packed({**header, "names": list(arrays)}, *arrays.values())
    return Response(body, media_type="application/octet-stream")


def refused(error: Exception) -> JSONResponse:
    return JSONResponse({"error": str(error), "field": field_of(str(error))}, status_code=422)


def field_of(message: str) -> str:
    """Return the field of the request that an error message is about, such as "friction.sigma_0".

    Such a message starts with the name of the field, often after the name of its record ("LuGre.sigma_0").
    The result is "" if the message names no field of the page.
    """
    found = re.match(r"(?:(\w+)\.)?(\w+)(?:\[(\d+)\])?", message)
    if found is None:
        return ""
    owner, field, index = found.groups()
    section = (
        "model"
        if owner == "Actuator"
        else "friction"
        if owner in law_types()
        else "waveform"
        if owner in shapes()
        else ""
    )
    if owner in registry.piezos.names():
        return f"model.{PIEZO}{field}"
    if section:
        return f"{section}.{field}" + (f"_{int(index) + 1}" if index else "")
    if message.startswith("drive voltage"):
        return "waveform.amplitude"
    return field if field in ("duration", "set", "law", "shape") else ""
