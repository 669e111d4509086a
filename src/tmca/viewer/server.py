"""The viewer's answers over HTTP: to this machine alone, to who knows the token in its address; it takes no orders."""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable
from typing import Annotated, Any

from fastapi import FastAPI, Query, Request
from fastapi.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.exceptions import HTTPException as AnyRefusal

from tmca.data import plain
from tmca.errors import TmcaError
from tmca.viewer.gallery import Gallery, NotShown
from tmca.viewer.page import policy, whole_page

_MOST = 2**31
_HEADERS = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
Place = Annotated[int, Query(ge=0, lt=_MOST)]
After = Annotated[int, Query(ge=-1, lt=_MOST)]
Step = Annotated[int, Query(ge=1, lt=_MOST)]


def application(gallery: Gallery, token: str, hosts: set[str]) -> FastAPI:
    """Answers of a gallery.

    Args:
        gallery: what is shown.
        token: without which every answer is a refusal.
        hosts: names, port included, by which a browser of this machine asks for it; others are those of somebody
            else's page.
    """
    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)

    @app.middleware("http")
    async def refuse_others(request: Request, go_on: Callable[[Request], Awaitable[Response]]) -> Response:
        given = request.query_params.get("token", "").encode(errors="replace")
        known = secrets.compare_digest(given, token.encode()) and request.headers.get("host") in hosts
        answer = await go_on(request) if known else PlainTextResponse("refused\n", 403)
        answer.headers.update(_HEADERS)
        return answer

    @app.exception_handler(TmcaError)
    async def say_what_is_wrong(request: Request, error: Exception) -> Response:
        return JSONResponse({"error": str(error)}, 409)

    @app.exception_handler(AnyRefusal)
    async def refuse(request: Request, error: Exception) -> Response:
        return PlainTextResponse("refused\n", getattr(error, "status_code", 404))

    @app.exception_handler(NotShown)
    async def there_is_none(request: Request, error: Exception) -> Response:
        return PlainTextResponse("there is no such thing\n", 404)

    _add_answers(app, gallery)
    return app


def _add_answers(app: FastAPI, gallery: Gallery) -> None:
    """The page, facts, planes, profiles."""

    @app.get("/")
    def page() -> Response:
        nonce = secrets.token_urlsafe(16)
        return HTMLResponse(whole_page(nonce), headers={"Content-Security-Policy": policy(nonce)})

    @app.get("/about")
    def about() -> Any:
        return JSONResponse(gallery.about())

    @app.get("/newest")
    def newest(after: After = -1) -> Any:
        return JSONResponse(plain(gallery.newest(after)))

    @app.get("/plane")
    def plane(
        item: Place, layer: str, index: Place, y1: Place, x1: Place, y0: Place = 0, x0: Place = 0, step: Step = 1
    ) -> Response:
        values = gallery.plane(item, layer, index, step, (y0, y1), (x0, x1))
        return Response(values.tobytes(), media_type="application/octet-stream")

    @app.get("/profile")
    def profile(item: Place, layer: str, y0: Place, y1: Place, x0: Place, x1: Place) -> Any:
        return JSONResponse(gallery.profile(item, layer, (y0, y1), (x0, x1)))
