"""Nobody but the user with the token gets an answer from the workbench."""

from __future__ import annotations

import pytest

pytest.importorskip("dash")

from youbot_scripts.interactive.app import build
from youbot_scripts.interactive.guard import COOKIE, MAX_BODY
from youbot_scripts.interactive.project import Project
from youbot_scripts.interactive.worker import Worker

TOKEN, PORT = "secret", 8055
HOME = f"http://127.0.0.1:{PORT}"


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory):
    """A test client of the server, which holds no cookie yet."""
    project = Project.open(tmp_path_factory.mktemp("logs"), "", [])
    app = build(project, Worker(project), TOKEN, PORT)

    def new():
        return app.server.test_client()

    return new


def status(client, path: str = "/_dash-layout", token: str = TOKEN, **more) -> int:
    if token:
        client.set_cookie(COOKIE, token, domain="127.0.0.1")
    return client.get(path, base_url=more.pop("base_url", HOME), **more).status_code


def test_the_token_opens_and_a_cookie_keeps_it_open(client):
    one = client()
    first = one.get(f"/?token={TOKEN}", base_url=HOME)
    assert first.status_code == 302 and "token" not in first.headers["Location"]
    cookie = first.headers["Set-Cookie"]
    assert "HttpOnly" in cookie and "SameSite=Strict" in cookie
    page = one.get("/", base_url=HOME)
    assert (
        page.status_code == 200 and "default-src 'self'" in page.headers["Content-Security-Policy"]
    )
    assert one.get("/_dash-layout", base_url=HOME).status_code == 200


def test_without_the_token_nothing_answers(client):
    for path in ("/", "/?token=", "/?token=secre", "/_dash-layout", "/_dash-dependencies"):
        assert status(client(), path, token="") == 403
    assert status(client(), token="wrong") == 403
    assert status(client()) == 200


def test_other_hosts_and_pages_are_refused(client):
    assert status(client(), base_url=f"http://evil.example:{PORT}") == 403
    assert status(client(), headers={"Origin": "http://evil.example"}) == 403
    assert status(client(), headers={"Origin": HOME}) == 200


def test_paths_out_of_the_folder_lead_nowhere(client):
    for path in ("/assets/../../project.py", "/assets/%2e%2e/app.py", "/../etc/passwd"):
        answer = client()
        answer.set_cookie(COOKIE, TOKEN, domain="127.0.0.1")
        found = answer.get(path, base_url=HOME)
        assert found.status_code == 404 or b"def " not in found.data


def test_huge_requests_are_refused_unread(client):
    one = client()
    one.set_cookie(COOKIE, TOKEN, domain="127.0.0.1")
    found = one.post(
        "/_dash-update-component", base_url=HOME, content_type="application/json",
        environ_overrides={"CONTENT_LENGTH": str(MAX_BODY + 1)},
    )  # fmt: skip
    assert found.status_code == 413
