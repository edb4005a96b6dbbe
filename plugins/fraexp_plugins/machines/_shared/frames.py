"""Messages over a socket: a table as JSON, and numbers behind it."""

import json
import select
import socket
import struct
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

LENGTHS = struct.Struct("<II")
"""What a message begins with: the lengths of its table and of its numbers."""
RECEIVE_SIZE = 1 << 20
"""Bytes that are received at once."""
Message = tuple[dict[str, Any], NDArray[np.float64]]


class FrameStream:
    """A socket that carries messages; ConnectionError when it is closed."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.socket = connection
        self._buffer = bytearray()
        self._complete: deque[Message] = deque()

    def send(self, table: dict[str, Any], numbers: NDArray[np.float64] | None = None) -> None:
        """Send a message."""
        text = json.dumps(table).encode()
        payload = b"" if numbers is None else np.ascontiguousarray(numbers, "<f8").tobytes()
        self.socket.sendall(LENGTHS.pack(len(text), len(payload)) + text + payload)

    def receive(self, timeout: float) -> Message | None:
        """Return the next message, or None if none is complete within `timeout` [s]."""
        while not self._complete:
            if not select.select([self.socket], [], [], timeout)[0]:
                return None
            received = self.socket.recv(RECEIVE_SIZE)
            if not received:
                raise ConnectionError("closed by the other side")
            self._buffer += received
            self._split()
        return self._complete.popleft()

    def _split(self) -> None:
        """Take complete messages from the buffer."""
        while len(self._buffer) >= LENGTHS.size:
            text, numbers = LENGTHS.unpack_from(self._buffer)
            end = LENGTHS.size + text + numbers
            if len(self._buffer) < end:
                return
            body = bytes(self._buffer[LENGTHS.size : end])
            del self._buffer[:end]
            self._complete.append((json.loads(body[:text]), np.frombuffer(body[text:], "<f8").copy()))

    def close(self) -> None:
        """Close the socket."""
        self.socket.close()
