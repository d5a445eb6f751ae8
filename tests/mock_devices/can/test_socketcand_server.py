"""The socketcand server with python-can's own client."""

from __future__ import annotations

import socket

import can
import pytest

from mock_devices.can.socketcand_server import SocketCandServer


@pytest.fixture
def server(bus_factory):
    server = SocketCandServer(bus_factory)
    yield server
    server.close()


@pytest.fixture
def client(server):
    host, port = server.address
    with can.Bus(interface="socketcand", channel="can0", host=host, port=port) as bus:
        yield bus


def frame(identifier, data, extended=False):
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=extended)


@pytest.mark.parametrize(
    ("identifier", "data", "extended"),
    [(0x080, b"", False), (0x181, bytes(range(8)), False), (0x1ABCDE, b"\xff\x00", True)],
)
def test_frames_pass_both_ways(client, bus_factory, identifier, data, extended):
    inside = bus_factory()
    client.send(frame(identifier, data, extended))
    got = inside.recv(10.0)
    assert (got.arbitration_id, bytes(got.data), got.is_extended_id) == (identifier, data, extended)
    inside.send(frame(identifier, data, extended))
    got = client.recv(10.0)
    while got is None:
        got = client.recv(10.0)
    assert (got.arbitration_id, bytes(got.data), got.is_extended_id) == (identifier, data, extended)


def test_two_clients_hear_each_other_and_not_themselves(server, client):
    host, port = server.address
    with can.Bus(interface="socketcand", channel="can0", host=host, port=port) as other:
        other.send(frame(0x700, b"\x05"))
        assert client.recv(10.0).arbitration_id == 0x700
        client.send(frame(0x701, b"\x05"))
        assert other.recv(10.0).arbitration_id == 0x701


def test_the_handshake_is_one_message_a_packet(server):
    with socket.create_connection(server.address, timeout=10) as raw:
        assert raw.recv(256) == b"< hi >"
        raw.sendall(b"< open can0 >")
        assert raw.recv(256) == b"< ok >"
        raw.sendall(b"< rawmode >")
        assert raw.recv(256) == b"< ok >"


@pytest.mark.parametrize("text", [b"< send 1 2 3 >", b"< send zz 0 >", b"< bcmmode >", b"nonsense >"])
def test_nonsense_is_answered_with_an_error(server, text):
    with socket.create_connection(server.address, timeout=10) as raw:
        raw.recv(256)
        raw.sendall(b"< open can0 >")
        raw.recv(256)
        raw.sendall(text)
        assert raw.recv(256).startswith(b"< error")


def test_a_client_that_leaves_does_not_disturb_the_next(server):
    host, port = server.address
    socket.create_connection(server.address).close()
    with can.Bus(interface="socketcand", channel="can0", host=host, port=port) as bus:
        bus.send(frame(0x080, b""))


def test_closing_twice_is_once(bus_factory):
    server = SocketCandServer(bus_factory)
    server.close()
    server.close()
