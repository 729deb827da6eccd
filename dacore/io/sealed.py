"""HDF5 files with a seal: a first block of text that says what the file is, and whether it is whole.

HDF5 lets a file begin with a block of the user's own. Here it holds one line of JSON (``head -c 512``
shows it): kind, schema, key, length and SHA-256 of everything after it, and at its end a checksum of
the block itself. So a file is judged

- cheaply, by its first 512 bytes and its length: right kind, schema and key, not cut short;
- wholly, before its content is used, by its checksum: HDF5 never parses a damaged file.

Any HDF5 tool still opens it. The file is put together in memory and written by plain writes, since
the HDF5 library cannot close a file for which a disk has no room.
"""

import hashlib
import io
import json
import os
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import BinaryIO

import h5py

from dacore.errors import StoreError
from dacore.io.atomic import atomic_path

BLOCK = 512
_SUM = 9  # eight hexadecimal digits and a line end
_PIECE = 1 << 20
_REMEDY = "delete it and run again"
_HDF5 = b"\x89HDF\r\n\x1a\n"


@dataclass(frozen=True)
class Seal:
    """What the first block says of the rest.

    Parameters
    ----------
    kind : str
        What the file holds, such as "dacore trajectory".
    schema : int
        Version of the layout.
    key : str
        What the content depends on, as a hash.
    bytes : int
        Length of the content [bytes].
    sha256 : str
        Of the content, hexadecimal.
    """

    kind: str
    schema: int
    key: str
    bytes: int
    sha256: str


def write_sealed(path: Path, kind: str, schema: int, key: str, fill: Callable[[h5py.File], None]) -> None:
    """Write a sealed file; it appears whole or not at all.

    Parameters
    ----------
    path : Path
    kind, schema, key
        See `Seal`.
    fill : callable
        Puts datasets and attributes into the open file. The same content gives the same bytes.

    Raises
    ------
    StoreError
        If the file cannot be written; what was at `path` is as it was.
    """
    # Layouts of HDF5 1.10 carry checksums of their own in the metadata, and no time of writing.
    # Python's own buffer: the library's in-memory driver gives its content as one more copy.
    image = io.BytesIO()
    with h5py.File(image, "w", libver=("v110", "v110"), userblock_size=BLOCK) as file:
        fill(file)
    content = image.getbuffer()[BLOCK:]
    block = _block(Seal(kind, schema, key, len(content), hashlib.sha256(content).hexdigest()))
    try:
        with atomic_path(path) as temporary, temporary.open("wb") as stream:
            stream.write(block)
            stream.write(content)
    except OSError as error:
        reason = error.strerror or str(error)
        raise StoreError(f"{path}: cannot be written ({reason}); is the disk full or read-only?") from error


def check_seal(path: Path, kind: str, schema: int, key: str) -> Seal:
    """Judge a file by its first block and its length alone.

    Raises
    ------
    StoreError
        If it is missing, empty, cut short, of another kind, schema or key, or its block is damaged.
    """
    with _opened(path) as stream:
        return _judged(path, stream, kind, schema, key)


@contextmanager
def open_sealed(path: Path, kind: str, schema: int, key: str) -> Iterator[h5py.File]:
    """Open a file for reading after its whole content was compared with its checksum.

    Raises
    ------
    StoreError
        As `check_seal`; and if the checksum, or what is read in the block of the `with`, does not fit.
    """
    # The same open file throughout: another process may put a new one in its place at any moment.
    with _opened(path) as stream:
        seal, found = _judged(path, stream, kind, schema, key), hashlib.sha256()
        try:
            while piece := stream.read(_PIECE):
                found.update(piece)
        except OSError as error:
            raise StoreError(f"{path}: cannot be read ({error.strerror}); run again") from error
        if found.hexdigest() != seal.sha256:
            raise StoreError(f"{path}: damaged (its checksum does not match); {_REMEDY}")
        try:
            with h5py.File(stream, "r") as file:
                yield file
        except (OSError, KeyError, ValueError, TypeError) as error:
            raise StoreError(f"{path}: not what its seal says ({error}); {_REMEDY}") from error


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    try:
        stream = path.open("rb")
    except OSError as error:
        raise StoreError(f"{path}: cannot be read ({error.strerror}); run again") from error
    with stream:
        yield stream


def _judged(path: Path, stream: BinaryIO, kind: str, schema: int, key: str) -> Seal:
    try:
        block, length = stream.read(BLOCK), os.fstat(stream.fileno()).st_size - BLOCK
    except OSError as error:
        raise StoreError(f"{path}: cannot be read ({error.strerror}); run again") from error
    seal = _parse(path, block, kind)
    if seal.schema != schema:
        raise StoreError(f"{path}: written with schema {seal.schema}, this version reads {schema}; {_REMEDY}")
    if seal.key != key:
        raise StoreError(f"{path}: belongs to other settings (key {seal.key}); {_REMEDY}")
    if length != seal.bytes:
        raise StoreError(f"{path}: damaged ({length} bytes of {seal.bytes}, cut short or added to); {_REMEDY}")
    return seal


def _block(seal: Seal) -> bytes:
    line = json.dumps(asdict(seal)).encode() + b"\n"
    if len(line) > BLOCK - _SUM:
        raise StoreError(f"key {seal.key[:40]}...: {len(seal.key)} characters, expected at most 200; use a hash")
    padded = line.ljust(BLOCK - _SUM)
    return padded + f"{zlib.crc32(padded):08x}\n".encode()


def _parse(path: Path, block: bytes, kind: str) -> Seal:
    if not block:
        raise StoreError(f"{path}: damaged (empty); {_REMEDY}")
    if block.startswith(_HDF5):
        raise StoreError(f"{path}: not a {kind} of this version (no seal); {_REMEDY}")
    padded = block[:-_SUM]
    try:
        told = json.loads(padded)
        seal = Seal(**told)
    except (ValueError, TypeError) as error:
        raise StoreError(f"{path}: damaged or not a {kind} (no seal); {_REMEDY}") from error
    if len(block) != BLOCK or block[-_SUM:] != f"{zlib.crc32(padded):08x}\n".encode():
        raise StoreError(f"{path}: damaged (its seal's checksum does not match); {_REMEDY}")
    if seal.kind != kind:
        raise StoreError(f"{path}: a {seal.kind}, expected a {kind}; {_REMEDY}")
    return seal
