"""Routes of the Move page, on which a user moves the actuator in closed loop."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request, Response

from .control import Control
from .explore import binary
from .moving import Act, LoopSettings, Moves


def move_routes(control: Control, moves: Moves) -> APIRouter:
    """Return the router with the routes of the Move page, below "/api/move".

    Only the page in control (`control`) may give commands. `moves` executes them.
    """
    routes = APIRouter(prefix="/api/move")

    @routes.get("/choices")
    def choices() -> dict[str, Any]:
        return moves.choices()

    @routes.post("/response")
    def response(asked: LoopSettings) -> Response:
        return binary(*moves.response(asked))

    @routes.post("/act")
    def act(asked: Act, request: Request) -> dict[str, bool]:
        control.need(request.headers.get("x-client", ""))
        moves.act(asked)
        return {"done": True}

    return routes
