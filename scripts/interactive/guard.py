"""Keeps strangers out of the workbench: only this machine's user, with the token, gets an answer.

A page of another site can make a browser send requests to a server on loopback. So each request
must carry a secret cookie that no other site's page can send (SameSite), name this server as its
host (a name that was bound to 127.0.0.1 is refused), and come from the workbench's own page.
"""

from __future__ import annotations

import hmac
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flask import Flask

COOKIE = "workbench"
MAX_BODY = 400 * 1024**2
"""Bytes of the largest request: a log of an hour at 1 kHz, dropped into the browser."""

CSP = (
    "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; "
    "script-src 'self' {scripts}; connect-src 'self'; object-src 'none'; base-uri 'none'; "
    "form-action 'self'; frame-ancestors 'none'"
)


def protect(server: Flask, token: str, port: int, hashes: list[str]) -> None:
    """Refuse every request that lacks the token, names another host, or comes from elsewhere.

    Parameters
    ----------
    token : secret of this run
    port : that the server listens on
    hashes : of the page's own inline scripts, for its content security policy
    """
    from flask import Response, abort, redirect, request

    server.config["MAX_CONTENT_LENGTH"] = MAX_BODY
    hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}
    origins = {f"http://{host}" for host in hosts}
    policy = CSP.format(scripts=" ".join(f"'{text}'" for text in hashes))

    @server.before_request
    def check() -> Any:
        if request.host not in hosts:
            abort(403, "this server answers on loopback only")
        origin = request.headers.get("Origin")
        if origin is not None and origin not in origins:
            abort(403, "requests from another page are refused")
        given = request.args.get("token", "")
        if request.method == "GET" and request.path == "/" and _same(given, token):
            answer = redirect("/")
            answer.set_cookie(COOKIE, token, httponly=True, samesite="Strict")
            return answer
        if not _same(request.cookies.get(COOKIE, ""), token):
            abort(403, "open the address that `youbot workbench` printed: it holds the token")
        if (request.content_length or 0) > MAX_BODY:
            abort(413)
        return None

    @server.after_request
    def seal(answer: Response) -> Response:
        answer.headers["Content-Security-Policy"] = policy
        answer.headers["X-Content-Type-Options"] = "nosniff"
        answer.headers["Referrer-Policy"] = "no-referrer"
        answer.headers["Cache-Control"] = "no-store"
        return answer


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode("utf-8", "replace"), token.encode())
