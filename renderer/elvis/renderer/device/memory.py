"""Memory of a device, reused from frame to frame: what nobody refers to any more serves the next buffer of its kind."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, TypeAlias
from weakref import WeakSet

from elvis.renderer.device.errors import DeviceError

if TYPE_CHECKING:
    import slangpy

#: bytes that are kept free at most
MOST_FREE = 256 << 20
#: elements up to which lengths are rounded up to powers of two, so that lists of any length find memory that is free
_DOUBLED = 1 << 16
#: message of the error where a closed device is used
CLOSED = "the device is closed: open another one"
#: bytes of an element, and number of elements
Kind: TypeAlias = tuple[int, int]


class Piece:
    """A piece of memory that serves one buffer after another.

    kind  bytes of an element, and number of elements
    size  bytes
    """

    __slots__ = ("__weakref__", "_address", "_memory", "kind", "size")

    def __init__(self, memory: slangpy.Buffer, kind: Kind) -> None:
        self._memory: slangpy.Buffer | None = memory
        self.kind, self.size = kind, int(memory.size)
        self._address: int | None = None

    @property
    def memory(self) -> slangpy.Buffer:
        """The slangpy buffer; DeviceError if the device is closed."""
        if self._memory is None:
            raise DeviceError(CLOSED)
        return self._memory

    @property
    def address(self) -> int:
        """Address for kernels, queried once; DeviceError if the device is closed."""
        memory = self.memory
        if self._address is None:
            self._address = memory.device_address
        return self._address

    def release(self) -> None:
        """Release the memory, even if it is still referenced."""
        self._memory = None


class Pool:
    """Memory that is free, by kind.

    create   makes memory of a kind
    made     pieces of memory that were made so far
    """

    def __init__(self, create: Callable[[int, int], slangpy.Buffer], most: int = MOST_FREE) -> None:
        self._create, self._most = create, most
        self._pieces: WeakSet[Piece] = WeakSet()
        self._free: defaultdict[Kind, list[Piece]] = defaultdict(list)
        self._bytes, self.made = 0, 0

    def take(self, itemsize: int, count: int) -> Buffer:
        """A buffer of elements without content, which may be what an earlier one has left."""
        kind = itemsize, rounded(count)
        free = self._free[kind]
        if free:
            piece = free.pop()
            self._bytes -= piece.size
        else:
            piece = self._make(kind)
        return Buffer(piece, itemsize * count, self)

    def _make(self, kind: Kind) -> Piece:
        """New memory; free pieces are released if there is no room otherwise."""
        self.made += 1
        try:
            memory = self._create(*kind)
        except RuntimeError:
            if not self._bytes:
                raise
            self.clear()
            memory = self._create(*kind)
        piece = Piece(memory, kind)
        self._pieces.add(piece)
        return piece

    def give(self, piece: Piece) -> None:
        """Keep memory for later, unless too much of it is free."""
        if self._bytes + piece.size <= self._most:
            self._bytes += piece.size
            self._free[piece.kind].append(piece)

    def clear(self) -> None:
        """Give all that is free back to the device."""
        self._free.clear()
        self._bytes = 0

    def close(self) -> None:
        """Release all memory, even if buffers are still referenced, and cache nothing from now on."""
        self._most = -1
        self.clear()
        for piece in self._pieces:
            piece.release()


class Buffer:
    """Memory of a device: free for other buffers with the last reference to it, given back when the device is closed.

    size  bytes that were requested; there may be more
    pool  where the memory is from, and goes to
    """

    __slots__ = ("_piece", "pool", "size")

    def __init__(self, piece: Piece, size: int, pool: Pool) -> None:
        self._piece, self.size, self.pool = piece, size, pool

    @property
    def memory(self) -> slangpy.Buffer:
        """The slangpy buffer; DeviceError if the device is closed."""
        return self._piece.memory

    @property
    def room(self) -> int:
        """Bytes that there are."""
        return self._piece.size

    @property
    def address(self) -> int:
        """Address for kernels; DeviceError if the device is closed."""
        return self._piece.address

    def __del__(self) -> None:
        self.pool.give(self._piece)


@lru_cache(maxsize=1024)
def rounded(count: int) -> int:
    """Elements that memory for ``count`` of them has room for: at most twice as many, of long lists an eighth more."""
    power = 1 << max(count - 1, 0).bit_length()
    step = 1 if power <= _DOUBLED else power >> 4
    return power if power <= _DOUBLED else -(-count // step) * step
