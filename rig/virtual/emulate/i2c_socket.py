"""An emulated I2C bus behind a Unix socket, for programs under the preload library (i2c_preload.c has the wire format).

One SOCK_SEQPACKET packet is one transaction, integers in the machine's byte order: u16 messages, then for each u16
address, u16 flags (1: read), u16 length, bytes of a write; the answer is an i32 errno and the bytes of all reads.
"""

from __future__ import annotations

import errno
import selectors
import shutil
import socket
import struct
import subprocess
import threading
from pathlib import Path
from typing import cast

from shockrig.files.disk import beside
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.virtual.i2c_dev import I2C_M_RD, Wire

SOURCE = Path(__file__).with_name("i2c_preload.c")
LONGEST_PACKET = 65536
_HEAD = struct.Struct("=HHH")


def answer(wire: Wire, packet: bytes) -> bytes:
    """Carry out one transaction; a failure is an answer too."""
    reads = b""
    try:
        (count,), at = struct.unpack_from("=H", packet), 2
        for _ in range(count):
            address, flags, length = _HEAD.unpack_from(packet, at)
            at += _HEAD.size
            if flags & I2C_M_RD:
                reads += wire.read(address, length)
            else:
                data, at = packet[at : at + length], at + length
                if len(data) != length:
                    return struct.pack("=i", errno.EPROTO)
                wire.write(address, data)
    except OSError as error:
        return struct.pack("=i", error.errno or errno.EIO)
    except struct.error:
        return struct.pack("=i", errno.EPROTO)
    return struct.pack("=i", 0) + reads


class I2cSocket:
    """Serves a wire at `path` from a thread of its own, to any number of programs, until it is closed."""

    def __init__(self, wire: Wire, path: Path) -> None:
        self.path = path
        self._wire = wire
        self._server = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._server.bind(str(path))
        except OSError as error:
            self._server.close()
            raise BenchError(f"{path}: {error.strerror or error}; give another --folder") from None
        self._server.listen()
        self._wake, self._waker = socket.socketpair()
        self._thread = threading.Thread(target=self._serve, name=f"i2c {path}", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        with selectors.DefaultSelector() as selector:
            for ours in (self._server, self._wake):
                selector.register(ours, selectors.EVENT_READ)
            while True:
                for key, _ in selector.select():
                    source = cast("socket.socket", key.fileobj)  # nothing else is registered
                    if source is self._wake:
                        for each in selector.get_map().values():
                            cast("socket.socket", each.fileobj).close()
                        return
                    if source is self._server:
                        selector.register(self._server.accept()[0], selectors.EVENT_READ)
                    elif not self._exchange(source):
                        selector.unregister(source)
                        source.close()

    def _exchange(self, program: socket.socket) -> bool:
        """One transaction; False where the program has gone."""
        try:
            packet = program.recv(LONGEST_PACKET)
            if packet:
                program.send(answer(self._wire, packet), socket.MSG_DONTWAIT)
        except OSError:
            return False
        return bool(packet)

    def close(self) -> None:
        """Hang up on everybody and take the socket's file away."""
        self._waker.close()
        self._thread.join(timeout=2)
        self.path.unlink(missing_ok=True)


def build_preload(target: Path) -> Path:
    """Compile the preload library, with the command that its source names; it appears whole or not at all.

    Raises
    ------
    BenchError
        There is no C compiler, or it refuses.
    """
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise BenchError(f"{target}: no C compiler (cc) to build it with; on Debian: apt install gcc libc6-dev")
    try:
        part = beside(target)
    except OSError as error:
        raise BenchError(f"{target}: {error.strerror}; name a file for the library") from None
    done = subprocess.run(
        [compiler, "-shared", "-fPIC", "-O2", "-o", str(part), str(SOURCE), "-ldl", "-lpthread"],
        capture_output=True,
        text=True,
    )
    if done.returncode:
        part.unlink(missing_ok=True)
        raise BenchError(f"{target}: {compiler} refused {SOURCE}: {done.stderr.strip()[:300]}")
    part.replace(target)
    return target
