"""The page server: access control, transmitted frames, and slow pages."""

from __future__ import annotations

import http.client
import json
import socket
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import ClientConnection, connect

from wherry.errors import InputError
from wherry.trace.codec import Decoder
from wherry.trace.framing import split_frames
from wherry.trace.records import Narration, Phase, Record
from wherry.views.web import broadcast as broadcasting
from wherry.views.web.broadcast import TraceBroadcast
from wherry.views.web.server import MAX_REQUEST_SIZE, RUN_OVER, PageServer, serve_run
from wherry_testing.runs import short_run, snapshot_at


@pytest.fixture
def broadcast() -> TraceBroadcast:
    made = TraceBroadcast()
    for record in short_run():
        made(record)
    return made


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "secret.txt").write_text("a secret")
    run = tmp_path / "run"
    run.mkdir()
    (run / "report.html").write_text("<p>The report")
    (run / "out").symlink_to(tmp_path / "secret.txt")
    return run


@pytest.fixture
def server(broadcast: TraceBroadcast, folder: Path) -> Iterator[PageServer]:
    with serve_run(broadcast, "A <run>", port=0, folder=folder) as running:
        yield running


def port_of(server: PageServer) -> int:
    return int(server.url.split(":")[2].split("/")[0])


def get(server: PageServer, path: str = "/", **headers: str) -> tuple[int, str, dict[str, str]]:
    connection = http.client.HTTPConnection("127.0.0.1", port_of(server), timeout=5)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    return answer.status, text, {name.lower(): value for name, value in answer.getheaders()}


def open_socket(
    server: PageServer, query: str = "", origin: str | None = "same", host: str | None = None
) -> ClientConnection:
    port = port_of(server)
    headers = {} if host is None else {"Host": host}
    own = f"http://127.0.0.1:{port}" if origin == "same" else origin
    return connect(f"ws://127.0.0.1:{port}/socket{query}", origin=own, additional_headers=headers, open_timeout=5)  # type: ignore[arg-type]


def received(page: ClientConnection) -> tuple[dict[str, object], bytes]:
    """The first message and all frames that a page receives until the run is over."""
    hello = json.loads(page.recv(timeout=5))
    frames = b""
    while True:
        message = page.recv(timeout=5)
        assert isinstance(message, bytes)
        frames += message[8:]
        if struct.unpack_from("<II", message)[1] & RUN_OVER:
            return hello, frames


def test_the_page_is_served_with_a_security_policy(server: PageServer) -> None:
    status, text, headers = get(server)
    assert status == 200
    assert "<title>A &lt;run&gt;</title>" in text
    assert "default-src &#39;none&#39;" in text
    assert headers["x-frame-options"] == "DENY"
    assert headers["x-content-type-options"] == "nosniff"


def test_a_page_gets_every_record_in_order(server: PageServer, broadcast: TraceBroadcast) -> None:
    broadcast.end()
    with open_socket(server) as page:
        _, frames = received(page)
    decoder = Decoder("socket")
    records = [decoder.decode(frame, "a frame") for frame in split_frames(frames)]
    assert [type(record) for record in records] == [type(record) for record in short_run()]


def test_a_reconnecting_page_gets_only_the_missing_frames(server: PageServer, broadcast: TraceBroadcast) -> None:
    broadcast.end()
    with open_socket(server, f"?run={broadcast.run_id}&from={len(broadcast) - 2}") as page:
        hello, frames = received(page)
    assert hello == {"run": broadcast.run_id, "from": len(broadcast) - 2}
    assert len(list(split_frames(frames))) == 2
    for query in ("?run=another&from=3", f"?run={broadcast.run_id}&from=-1", f"?run={broadcast.run_id}&from=x"):
        with open_socket(server, query) as page:
            assert json.loads(page.recv(timeout=5))["from"] == 0


def test_a_later_record_is_sent(server: PageServer, broadcast: TraceBroadcast) -> None:
    with open_socket(server) as page:
        page.recv(timeout=5)
        page.recv(timeout=5)
        broadcast(Narration(11.0, Phase.DONE, "Later"))
        message = page.recv(timeout=5)
        assert isinstance(message, bytes)
        assert b"Later" in message


@pytest.mark.parametrize("origin", ["https://evil.example", "http://127.0.0.1:1", "null", None])
def test_a_foreign_page_cannot_connect(server: PageServer, origin: str | None) -> None:
    with pytest.raises((InvalidHandshake, ConnectionClosed)), open_socket(server, origin=origin) as page:
        page.recv(timeout=5)


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "127.0.0.1:{port}.evil.example"]
)
def test_a_rebound_host_name_is_refused(server: PageServer, host: str) -> None:
    status, text, _ = get(server, Host=host.format(port=port_of(server)))
    assert status == 403
    assert "Refused" in text


def test_a_request_from_a_foreign_page_is_refused(server: PageServer) -> None:
    assert get(server, Origin="https://evil.example")[0] == 403


def test_requests_over_the_network_need_the_token(broadcast: TraceBroadcast) -> None:
    with serve_run(broadcast, "run", host="0.0.0.0", port=0) as server:  # noqa: S104 - the case under test
        token = server.url.split("token=")[1]
        assert len(token) > 16
        assert get(server, f"/?token={token}")[0] == 200
        assert get(server)[0] == 403
        assert get(server, "/?token=")[0] == 403
        assert get(server, f"/?token={token[:-1]}")[0] == 403
        with pytest.raises((InvalidHandshake, ConnectionClosed)), open_socket(server) as page:
            page.recv(timeout=5)
        with open_socket(server, f"?token={token}") as page:
            assert json.loads(page.recv(timeout=5))["run"] == broadcast.run_id


@pytest.mark.parametrize(
    "path",
    [
        "/files/../secret.txt",
        "/files/%2e%2e/secret.txt",
        "/files/..%2fsecret.txt",
        "/files/out",
        "/files//etc/passwd",
        "/files/%00",
        "/nothing",
    ],
)
def test_files_outside_the_run_folder_are_not_served(server: PageServer, path: str) -> None:
    status, text, _ = get(server, path)
    assert status in {400, 404}
    assert "a secret" not in text


def test_the_report_is_served(server: PageServer) -> None:
    assert get(server, "/files/report.html")[:2] == (200, "<p>The report")


def test_a_page_that_sends_too_much_is_disconnected(server: PageServer) -> None:
    with open_socket(server) as page:
        page.send("x" * (MAX_REQUEST_SIZE + 1))
        with pytest.raises(ConnectionClosed, match="1009"):
            list(iter(lambda: page.recv(timeout=5), None))


def test_the_address_of_another_machine_is_rejected(broadcast: TraceBroadcast) -> None:
    with (
        pytest.raises(InputError, match=r"--host: 192\.0\.2\.1: cannot be listened on"),
        serve_run(broadcast, "x", host="192.0.2.1"),
    ):
        pass


def test_an_occupied_port_is_replaced_by_another(broadcast: TraceBroadcast, server: PageServer) -> None:
    with serve_run(broadcast, "x", port=port_of(server)) as other:
        assert port_of(other) != port_of(server)
        assert (other.occupied_port, server.occupied_port) == (port_of(server), None)
        assert get(other)[0] == 200


def test_waiting_for_the_first_page_times_out() -> None:
    server = PageServer("http://127.0.0.1/")
    before = time.monotonic()
    assert not server.wait_until_unwatched(timeout=0.4)
    assert 0.4 <= time.monotonic() - before < 5.0
    server.page_connected()
    server.page_disconnected()
    assert server.wait_until_unwatched(timeout=0.0)


def alternating_run(count: int) -> list[Record]:
    """A run of narrations and snapshots in turn."""
    return [
        record
        for step in range(count)
        for record in (Narration(float(step), Phase.EXPLORE, "y"), snapshot_at(float(step), 0.0, particles=9))
    ]


def count_frames(broadcast: TraceBroadcast) -> tuple[int, int]:
    """Numbers of narrations and snapshots that a newly opened page receives."""
    index, narrations, snapshots = 0, 0, 0
    while index < len(broadcast):
        batch = broadcast.batch_from(index)
        index = batch.next_index
        for frame in split_frames(batch.frames):
            narrations += b'"type":"Said"' in frame
            snapshots += b'"type":"Seen"' in frame
    return narrations, snapshots


def test_a_slow_page_gets_fewer_snapshots_and_all_other_records(monkeypatch: pytest.MonkeyPatch) -> None:
    broadcast = TraceBroadcast()
    for record in alternating_run(200):
        broadcast(record)
    assert count_frames(broadcast) == (200, 200)
    monkeypatch.setattr(broadcasting, "MAX_BACKLOG_SIZE", 10_000)
    narrations, snapshots = count_frames(broadcast)
    assert narrations == 200
    assert 10 < snapshots < 100


def test_messages_have_a_maximum_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(broadcasting, "MAX_MESSAGE_SIZE", 2_000)
    broadcast = TraceBroadcast()
    for record in alternating_run(50):
        broadcast(record)
    assert len(broadcast.batch_from(0).frames) <= 2_000
    assert count_frames(broadcast) == (50, 50)


def test_a_long_run_keeps_fewer_snapshots_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(broadcasting, "MAX_HISTORY_SIZE", 20_000)
    broadcast = TraceBroadcast()
    for record in alternating_run(500):
        broadcast(record)
    assert sum(map(len, broadcast._frames)) < 20_000 + 500 * 200
    narrations, snapshots = count_frames(broadcast)
    assert narrations == 500
    assert snapshots > 10


def test_a_page_that_reads_nothing_blocks_no_other_page(server: PageServer, broadcast: TraceBroadcast) -> None:
    with socket.create_connection(("127.0.0.1", port_of(server))) as silent:
        lines = (
            "GET /socket HTTP/1.1",
            f"Host: 127.0.0.1:{port_of(server)}",
            f"Origin: http://127.0.0.1:{port_of(server)}",
            "Upgrade: websocket",
            "Connection: Upgrade",
            "Sec-WebSocket-Version: 13",
            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
        )
        silent.sendall("\r\n".join((*lines, "", "")).encode())
        assert silent.recv(12) == b"HTTP/1.1 101"
        record = snapshot_at(0.0, 0.0, particles=2000)
        for _ in range(2000):  # 24 MB, more than the buffers of the connection
            broadcast(record)
        broadcast.end()
        with open_socket(server) as reading:
            assert len(list(split_frames(received(reading)[1]))) > 1000
