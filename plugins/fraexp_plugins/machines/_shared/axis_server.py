"""A simulated machine as a process of its own: it plays what it is sent, and stops when it hears nothing.

``python -m`` this module: it reads its order, one line of JSON, from standard input, and writes its port to standard
output as soon as it can play.
"""

import json
import random
import select
import socket
import sys
import time
from collections import deque
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.api import LiveLoop, PlayRequest, live_setup

Message = tuple[dict[str, Any], NDArray[np.float64]]


class MessageStream:
    """A socket that carries tables with numbers; ConnectionError when it is closed."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection = Connection(connection.detach())
        self.close = self.connection.close

    def send(self, table: dict[str, Any], numbers: NDArray[np.float64] | None = None) -> None:
        """Send a message in one piece: between two pieces the sender may be interrupted, and send a stop instead."""
        more = b"" if numbers is None else np.ascontiguousarray(numbers, "<f8").tobytes()
        self.connection.send_bytes(json.dumps(table).encode() + b"\n" + more)

    def receive(self, timeout: float) -> Message | None:
        """Return the next message, or None if none comes within `timeout` [s]."""
        try:
            if not self.connection.poll(timeout):
                return None
            table, _, numbers = self.connection.recv_bytes().partition(b"\n")
        except EOFError:
            raise ConnectionError("closed by the other side") from None
        return json.loads(table), np.frombuffer(numbers, "<f8").copy()


TICK_S = 0.002
"""Longest wait for messages."""
PACKET_TIME_S, LOCKSTEP_SAMPLES = 0.02, 50
"""Machine time of a packet in real time, and samples of one where the machine waits for whoever measures."""
LINGER_S = 3.0
"""Time without a connection after which the process ends."""


class _AxisPlay:
    """A period that is being played, with all that was recorded of it."""

    def __init__(self, request: PlayRequest, name: int, loop: LiveLoop, channels: list[str]) -> None:
        self.request, self.name, self._loop, self._channels = request, name, loop, channels
        self.began = time.monotonic()
        self.stop: int | None = None
        self.reason = ""
        self.recorded = np.zeros((len(channels), request.samples))  # memory is used as it is filled
        self.produced = 0
        self.acknowledged = 0
        self.has_rested = False
        self.is_off = False
        """Whether the drive is off: a brake then holds the axis where it is, and no control input acts."""

    @property
    def end(self) -> int:
        """Sample after the last one."""
        samples = self.request.samples
        return samples if self.stop is None else min(self.stop + self.request.ramp_out, samples)

    def advance(self, samples: int) -> None:
        """Play on, up to a number of samples from the start."""
        until = min(samples, self.end)
        if until > self.produced and self.is_off:
            self.recorded[0, self.produced : until] = self.recorded[0, max(self.produced - 1, 0)]
        elif until > self.produced:
            played = self._loop.play(self.request.excitation(self.produced, until, self.stop))
            self.recorded[:, self.produced : until] = [played[name] for name in self._channels]
        self.produced = max(self.produced, until)

    def halt(self, reason: str) -> None:
        """Begin the ramp out."""
        if self.stop is None:
            self.stop, self.reason = self.produced, reason


class _AxisServer:
    """Serves one machine to one connection at a time, with losses and delays to order."""

    def __init__(self, order: dict[str, Any], listener: socket.socket) -> None:
        self._order, self._listener = order, listener
        self._setup = live_setup(order["sections"], Path(order["folder"]))
        self._names = list(order["channels"])
        self._loop = LiveLoop(self._setup)
        self._loop.play(np.zeros(8))  # its law is compiled before the machine says that it is ready
        self._loop = LiveLoop(self._setup)
        self._random = random.Random(order["seed"])
        self._stream: MessageStream | None = None
        self._play: _AxisPlay | None = None
        self._outbox: deque[tuple[float, dict[str, Any], NDArray[np.float64] | None]] = deque()
        self._heard = self._connected = time.monotonic()
        self._sent, self._total, self._is_cut, self._quits = 0, 0, order["cut_after"] == 0, False

    def serve(self) -> None:
        """Serve until the machine rests and either was asked to quit, or nobody is connected any more."""
        while True:
            self._hear()
            self._watch()
            self._move()
            self._send_due()
            is_lonely = self._stream is None and time.monotonic() - self._connected > LINGER_S
            if (is_lonely or self._quits) and (self._play is None or self._play.has_rested):
                return

    def _note(self, event: str, **more: object) -> None:
        """Write an event to the log, if there is one."""
        if self._order["log"]:
            with Path(self._order["log"]).open("a", encoding="utf-8") as stream:
                stream.write(json.dumps({"event": event, "time": time.monotonic(), **more}) + "\n")

    def _hear(self) -> None:
        """Accept a connection, and handle all messages that have arrived."""
        sources: list[socket.socket | Connection] = [
            self._listener,
            *([self._stream.connection] if self._stream else []),
        ]
        wait = 0.0 if self._is_behind() else TICK_S
        ready, _, _ = select.select(sources, [], [], wait)
        if self._listener in ready:
            self._disconnect()
            self._stream, self._heard = MessageStream(self._listener.accept()[0]), time.monotonic()
        if self._stream is not None and self._stream.connection in ready:
            try:
                while message := self._stream.receive(0.0):
                    self._heard = time.monotonic()
                    self._answer(message)
            except OSError:
                self._disconnect()

    def _disconnect(self) -> None:
        if self._stream is not None:
            self._stream.close()
            self._stream, self._connected = None, time.monotonic()
            self._outbox.clear()

    def _answer(self, message: Message) -> None:
        table, numbers = message
        play = self._play
        match table["do"]:
            case "play":
                self._begin(table, numbers)
            case "acknowledge" if play:
                play.acknowledged = table["samples"]
            case "again" if play:
                self._resend(play, table["start"], min(table.get("end", play.produced), self._sent))
            case "stop" if play:
                play.halt("")
            case "disable" if play:
                play.is_off = True
                play.halt("")
                self._note("off", sample=play.produced)
            case "quit":
                self._quits = True
                if play:
                    play.halt("")

    def _begin(self, table: dict[str, Any], waveform: NDArray[np.float64]) -> None:
        shape = (table["repetitions"], table["amplitude_rise"], table["ramp_out"])
        request = PlayRequest(table["number"], waveform, *shape)
        if self._order["from_rest"]:
            self._loop = LiveLoop(self._setup, request.number)
        was_off = self._play is not None and self._play.is_off
        self._play, self._sent = _AxisPlay(request, table["name"], self._loop, self._names), 0
        self._play.is_off = was_off
        self._note("play", number=request.number)

    def _watch(self) -> None:
        """Stop the machine where nothing was heard for the time of the watchdog."""
        play = self._play
        if play and play.stop is None and not play.has_rested:
            silent = time.monotonic() - self._heard
            if silent > self._order["watchdog"]:
                play.halt("watchdog")
                self._note("watchdog", silent=silent, last_sign_of_life=self._heard)

    def _is_behind(self) -> bool:
        """Say whether there is something to play at once."""
        return self._play is not None and self._play.produced < min(self._due(self._play), self._play.end)

    def _due(self, play: _AxisPlay) -> int:
        """Return up to which sample the machine should have played."""
        speed, sample_time = self._order["speed"], self._setup.sample_time
        if speed:
            return int((time.monotonic() - play.began) * speed / sample_time)
        return play.end if play.stop is not None else play.acknowledged + LOCKSTEP_SAMPLES

    def _move(self) -> None:
        """Play what is due, and post it in packets."""
        play = self._play
        if play is None or play.has_rested:
            return
        packet = LOCKSTEP_SAMPLES
        if self._order["speed"]:
            packet = max(round(PACKET_TIME_S * self._order["speed"] / self._setup.sample_time), 1)
        before = play.produced
        play.advance(min(self._due(play), before + packet))
        self._total += play.produced - before
        if not self._is_cut and self._total * self._setup.sample_time > self._order["cut_after"]:
            self._is_cut = True
            self._note("cut")
            self._disconnect()
        is_over = play.produced >= play.end
        if play.produced - self._sent >= packet or is_over:
            self._post_samples(play, self._sent, play.produced)
            self._sent = play.produced
        if is_over:
            play.has_rested = True
            self._note("rest", reason=play.reason, samples=play.produced)
            self._post_end(play)

    def _resend(self, play: _AxisPlay, start: int, end: int) -> None:
        for begin in range(start, end, LOCKSTEP_SAMPLES):
            self._post_samples(play, begin, min(begin + LOCKSTEP_SAMPLES, end))
        if play.has_rested:
            self._post_end(play)

    def _post_samples(self, play: _AxisPlay, start: int, end: int) -> None:
        if end > start:
            self._post({"is": "samples", "of": play.name, "start": start}, play.recorded[:, start:end])

    def _post_end(self, play: _AxisPlay) -> None:
        self._post({"is": "end", "of": play.name, "samples": play.produced, "reason": play.reason})

    def _post(self, table: dict[str, Any], numbers: NDArray[np.float64] | None = None) -> None:
        """Have a message sent after the delay, unless it gets lost."""
        if self._stream is not None and self._random.random() >= self._order["loss"]:
            self._outbox.append((time.monotonic() + self._order["delay"], table, numbers))

    def _send_due(self) -> None:
        try:
            while self._stream and self._outbox and self._outbox[0][0] <= time.monotonic():
                _, table, numbers = self._outbox.popleft()
                self._stream.send(table, numbers)
        except OSError:
            self._disconnect()


def main() -> None:
    """Read the order, say the port, and serve."""
    order = json.loads(sys.stdin.readline())
    with socket.create_server(("127.0.0.1", 0)) as listener:
        try:
            server = _AxisServer(order, listener)
        except Exception as error:  # whatever a plugin's law raises: the client reports it
            print(json.dumps({"error": str(error).splitlines()[0] if str(error) else type(error).__name__}), flush=True)
            return
        print(json.dumps({"port": listener.getsockname()[1]}), flush=True)
        server.serve()


if __name__ == "__main__":
    main()
