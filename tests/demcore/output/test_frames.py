"""The journal of frames: what was appended comes back, whatever was torn off its end."""

from __future__ import annotations

import numpy as np
import pytest

from demcore.output.frames import FrameJournal


@pytest.fixture
def journal(tmp_path):
    journal = FrameJournal(tmp_path / "journal")
    for k in range(4):
        journal.append(0.5 * k, {"a": np.arange(k), "b": np.full((2, 3), k, np.float32)})
    return journal


def times(journal):
    return [time for time, _ in journal.frames()]


def test_frames_come_back_in_order(journal):
    read = list(journal.frames())
    assert [time for time, _ in read] == [0.0, 0.5, 1.0, 1.5]
    for k, (_, arrays) in enumerate(read):
        np.testing.assert_array_equal(arrays["a"], np.arange(k))
        assert arrays["b"].dtype == np.float32


@pytest.mark.parametrize(("time", "kept"), [(-1.0, 0), (0.0, 1), (0.7, 2), (1.5, 4), (9.0, 4)])
def test_a_cut_keeps_what_is_not_later(journal, time, kept):
    journal.cut(time)
    assert times(journal) == [0.0, 0.5, 1.0, 1.5][:kept]
    journal.append(7.0, {})
    assert times(journal)[-1] == 7.0


def test_a_journal_torn_anywhere_ends_with_its_last_whole_frame(journal):
    whole = journal.path.read_bytes()
    journal.cut(1.0)
    third = journal.path.stat().st_size
    for size in (third, third + 1, third + 39, third + 40, third + 300, len(whole) - 1):
        journal.path.write_bytes(whole[:size])
        assert times(journal) == [0.0, 0.5, 1.0]
        journal.cut(9.0)
        assert journal.path.stat().st_size == third


def test_a_flipped_bit_ends_the_journal_before_it(journal):
    spoilt = bytearray(journal.path.read_bytes())
    spoilt[len(spoilt) // 2] ^= 1
    journal.path.write_bytes(bytes(spoilt))
    assert len(times(journal)) < 4


def test_no_journal_has_no_frames(tmp_path):
    journal = FrameJournal(tmp_path / "none")
    journal.cut(1.0)
    journal.discard()
    assert times(journal) == []
