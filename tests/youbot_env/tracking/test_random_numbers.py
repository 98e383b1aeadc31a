"""The counter-based generator is the published one, and its numbers are what is drawn from them."""

from __future__ import annotations

import numpy as np
import pytest

from youbot_env.tracking.random_numbers import NOISE, philox, words

ONES = 0xFFFFFFFF

# Known answers that the authors publish with Random123: counter, key, words.
PUBLISHED = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((ONES,) * 4, (ONES,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]


@pytest.mark.parametrize(("counter", "key", "expected"), PUBLISHED)
def test_gives_the_published_words(counter, key, expected):
    found = philox(*(np.uint64(value) for value in (*counter, *key)))
    assert tuple(int(word) for word in found) == expected


def test_streams_differ_in_key_episode_and_purpose():
    key = np.uint64(7)
    found = {
        words(key, 0, NOISE, 0),
        words(np.uint64(8), 0, NOISE, 0),
        words(np.uint64(7 + 2**32), 0, NOISE, 0),
        words(key, 1, NOISE, 0),
        words(key, 0, NOISE + 1, 0),
        words(key, 0, NOISE, 1),
    }
    assert len(found) == 6
