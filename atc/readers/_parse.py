"""Numba kernels that turn bytes of text into columns of numbers, and put atoms in order.

Numbers are correctly rounded: what comes out is what Python's ``float()`` gives. Short ones (mantissa below 2^53 and a
power of ten up to 10^22, both exact doubles) need one multiplication or division (Clinger 1990). Longer ones, up to 19
digits, go through the 128-bit product of Eisel and Lemire (D. Lemire, Number parsing at a gigabyte per second, 2021),
which knows when it cannot decide; those, and anything unusual ("nan", 20 digits, 1e400), are handed back as positions
in the text for Python's ``float()``.
"""

from __future__ import annotations

import numpy as np

from ..compiled import njit

FLOAT, INT, TEXT = 0, 1, 2
DONE, FULL, SHORT, LONG = 0, 1, 2, 3
# Bytes looked through at a time: what a processor keeps near.
_BLOCK = 1 << 15

_MIN10, _MAX10 = -330, 308


def _tables():
    """The top 128 bits (truncated) of 10^e as two 64-bit words, for the exponents a double can need."""
    hi, lo = [], []
    for e in range(_MIN10, _MAX10 + 1):
        if e >= 0:
            m = 10**e
            m = m << (128 - m.bit_length()) if m.bit_length() <= 128 else m >> (m.bit_length() - 128)
        else:
            d = 10**-e
            m = (1 << (128 + d.bit_length())) // d
            m >>= m.bit_length() - 128
        hi.append(m >> 64)
        lo.append(m & (2**64 - 1))
    return np.array(hi, np.uint64), np.array(lo, np.uint64)


_HI10, _LO10 = _tables()
_TEN = np.array([10.0**k for k in range(23)])
_TWO = np.array([2.0 ** (max(k, 1) - 1075) for k in range(2047)])  # 2^(biased exponent) for a 53-bit integer mantissa

_U = np.uint64
_LOW32, _MASK9, _LIMIT53 = _U(0xFFFFFFFF), _U(0x1FF), _U(1) << _U(53)
_ZERO, _ONE, _THREE, _TENU, _S32, _S63 = _U(0), _U(1), _U(3), _U(10), _U(32), _U(63)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _mul64(a, b):
    """High and low word of the 128-bit product of two 64-bit words."""
    a1, a0 = a >> _S32, a & _LOW32
    b1, b0 = b >> _S32, b & _LOW32
    low = a0 * b0
    mid = a1 * b0 + (low >> _S32)
    mid2 = a0 * b1 + (mid & _LOW32)
    return a1 * b1 + (mid >> _S32) + (mid2 >> _S32), a * b


@njit(cache=True, nogil=True, error_model="numpy", no_cpython_wrapper=True)
def _eisel_lemire(man, e10):
    """(man · 10^e10 correctly rounded, True), or (0, False) where 128 bits do not decide."""
    if e10 < _MIN10 or e10 > _MAX10:
        return 0.0, False
    shift = 0
    while (man >> _S63) == _ZERO:
        man = man << _ONE
        shift += 1
    exp2 = ((217706 * e10) >> 16) + 64 + 1023 - shift
    hi, lo = _mul64(man, _HI10[e10 - _MIN10])
    if (hi & _MASK9) == _MASK9 and lo + man < man:
        yhi, ylo = _mul64(man, _LO10[e10 - _MIN10])
        mlo = lo + yhi
        mhi = hi + _ONE if mlo < lo else hi
        if (mhi & _MASK9) == _MASK9 and mlo + _ONE == _ZERO and ylo + man < man:
            return 0.0, False
        hi, lo = mhi, mlo
    msb = hi >> _S63
    out = hi >> (msb + _U(9))  # 54 bits: one more than a double holds
    if msb == _ZERO:
        exp2 -= 1
    if lo == _ZERO and (hi & _MASK9) == _ZERO and (out & _THREE) == _ONE:
        return 0.0, False  # perhaps exactly half-way
    out = (out + (out & _ONE)) >> _ONE
    if out >= _LIMIT53:
        out = out >> _ONE
        exp2 += 1
    if exp2 < 1 or exp2 > 2046:
        return 0.0, False
    return np.float64(np.int64(out)) * _TWO[exp2], True


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _number(buf, p):
    """(value, ok, position behind the token). Not ok: Python has to look at it."""
    c = buf[p]
    negative = c == 45
    if negative or c == 43:
        p += 1
    man = _ZERO
    first = start = p
    while True:
        d = np.int64(buf[p]) - 48
        if d < 0 or d > 9:
            break
        man = man * _TENU + _U(d)
        p += 1
    digits = p - start
    e10 = 0
    dot = buf[p] == 46
    if dot:
        p += 1
        start = p
        while True:
            d = np.int64(buf[p]) - 48
            if d < 0 or d > 9:
                break
            man = man * _TENU + _U(d)
            p += 1
        e10 = start - p
        digits += p - start
    if digits > 19:  # leading zeros do not count: they added nothing to the mantissa
        start = first
        while buf[start] == 48 or buf[start] == 46:
            digits -= buf[start] == 48
            start += 1
    ok = digits <= 19 and p > first + dot
    if buf[p] == 101 or buf[p] == 69:
        p += 1
        minus = buf[p] == 45
        if minus or buf[p] == 43:
            p += 1
        start = p
        e = 0
        while True:
            d = np.int64(buf[p]) - 48
            if d < 0 or d > 9:
                break
            if e < 100000:
                e = 10 * e + d
            p += 1
        if p == start:
            ok = False
        e10 += -e if minus else e
    if buf[p] > 32:
        while buf[p] > 32:
            p += 1
        ok = False
    value = 0.0
    if ok and man != _ZERO:
        if man < _LIMIT53 and -22 <= e10 <= 22:
            value = np.float64(np.int64(man))
            value = value * _TEN[e10] if e10 >= 0 else value / _TEN[-e10]
        else:
            value, ok = _eisel_lemire(man, e10)
    return (-value if negative else value), ok, p


@njit(cache=True, nogil=True, error_model="numpy")
def parse_table(buf, pos, kind_k, slot_k, row, n_row, floats, ints, texts, hard):
    """Parse lines `row`..`n_row` of a table of white-space separated columns that starts at byte `pos`.

    `buf` must hold `n_row` complete lines (each with its line end). Column k is a `kind_k[k]` (FLOAT, INT, TEXT) and
    goes to
    ``floats[row, slot]`` or ``ints[row, slot]``, or its byte range to ``texts[row, slot]``. Tokens that Python has to
    convert are listed in `hard` as (row, column, begin, end). Blank lines are not skipped.

    Returns (status, row, pos, number of hard ones): DONE; FULL, resume at `row`, `pos` after emptying `hard`; SHORT or
    LONG, line `row` has the wrong number of columns.
    """
    n_col = len(kind_k)
    n_hard = 0
    while row < n_row:
        if n_hard + n_col > len(hard):
            return FULL, row, pos, n_hard
        line = pos
        for k in range(n_col):
            while buf[pos] == 32 or buf[pos] == 9 or buf[pos] == 13:
                pos += 1
            if buf[pos] == 10:
                return SHORT, row, line, n_hard
            begin = pos
            kind = kind_k[k]
            if kind == FLOAT:
                value, ok, pos = _number(buf, pos)
                floats[row, slot_k[k]] = value
            elif kind == INT:
                negative = buf[pos] == 45
                if negative or buf[pos] == 43:
                    pos += 1
                v = 0
                first = pos
                while True:
                    d = np.int64(buf[pos]) - 48
                    if d < 0 or d > 9:
                        break
                    v = 10 * v + d
                    pos += 1
                ok = 0 < pos - first <= 18
                while buf[pos] > 32:
                    ok = False
                    pos += 1
                ints[row, slot_k[k]] = -v if negative else v
            else:
                ok = True
                while buf[pos] > 32:
                    pos += 1
                texts[row, slot_k[k], 0] = begin
                texts[row, slot_k[k], 1] = pos
            if not ok:
                hard[n_hard, 0] = row
                hard[n_hard, 1] = k
                hard[n_hard, 2] = begin
                hard[n_hard, 3] = pos
                n_hard += 1
        while buf[pos] == 32 or buf[pos] == 9 or buf[pos] == 13:
            pos += 1
        if buf[pos] != 10:
            return LONG, row, line, n_hard
        pos += 1
        row += 1
    return DONE, row, pos, n_hard


#: So many numbers of a process are read by Python itself: it gives the same, in a few hundredths of a second, where
#: compiling `parse_table`, the first time ever, takes one.
FIRST_BY_PYTHON = 200_000
_by_python = 0
_PLAIN = np.isin(np.arange(256), list(b"0123456789+-.eE \t\r\n"))


def read_table(buf, pos, kind_k, slot_k, row, n_row, floats, ints, texts, hard):
    """`parse_table`, not compiled for the first few tables."""
    global _by_python
    count = (n_row - row) * len(kind_k)
    if row == 0 and not texts.size and count <= FIRST_BY_PYTHON - _by_python:
        end = _plainly(buf[pos:], kind_k, slot_k, n_row, floats, ints)
        if end is not None:
            _by_python += count
            return DONE, n_row, pos + end, 0
    return parse_table(buf, pos, kind_k, slot_k, row, n_row, floats, ints, texts, hard)


def _plainly(buf, kind_k, slot_k, n, floats, ints):
    """Fill in n lines of plain numbers, as Python reads them: where they end, None if there is anything else."""
    end, found = skip_lines(buf, n)
    block, width = buf[:end], len(kind_k)
    if found < n or not _PLAIN[block].all():
        return None
    inside = block > 32
    begins = np.diff(inside, prepend=False) & inside
    if not np.array_equal(np.cumsum(begins)[block == 10], width * np.arange(1, n + 1)):
        return None
    words = block.tobytes().split()
    try:
        for k in range(width):
            column, kind = words[k::width], int if kind_k[k] == INT else float
            (ints if kind is int else floats)[:, slot_k[k]] = list(map(kind, column))
    except (ValueError, OverflowError):
        return None
    return end if np.isfinite(floats).all() else None


def skip_lines(buf, n):
    """(position behind the n-th line end, n), or (len(buf), the number of line ends there are) if there are fewer."""
    seen = 0
    for p in range(0, len(buf) if n > 0 else 0, _BLOCK):
        ends = buf[p : p + _BLOCK] == 10
        here = int(np.count_nonzero(ends))
        if seen + here >= n:
            return p + int(np.flatnonzero(ends)[n - seen - 1]) + 1, n
        seen += here
    return (len(buf), seen) if n > 0 else (0, 0)


def sorting(ids, order):
    """Fill `order` so that ids[order] ascends. Returns (state, row): 0 sorted already, 1 order filled, 2 `row` repeats
    an id, 3 too spread."""
    n = len(ids)
    if (ids[1:] > ids[:-1]).all():
        return 0, 0
    low = int(ids.min())
    span = int(ids.max()) - low + 1
    if span > 8 * n + 1024:
        return 3, 0
    at, row = ids - low, np.arange(n)
    place = np.full(span, -1, np.int64)
    place[at[::-1]] = row[::-1]  # of rows with one id, the first
    again = place[at] != row
    if again.any():
        return 2, int(again.argmax())
    order[:] = place[place >= 0]
    return 1, 0


@njit(cache=True, nogil=True, error_model="numpy")
def gather(column, order, scale, out):
    """out[k] = column[order[k]] · scale."""
    for k in range(len(order)):
        out[k] = column[order[k]] * scale
