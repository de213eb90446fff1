"""On-board, receiver and GPS time, and the tags of the instruments; seconds of the day in all three scales."""

import numpy as np

_OFFSETS_NS = np.array([0, 119, -119, 238, -238])


class Clocks:
    """The mapping that TIM1B and CLK1B of one day state."""

    def __init__(self, rng, offset_s, drift):
        self.clock_time = np.arange(-300, 86701, 10)
        self.clock_offset = offset_s + drift * self.clock_time + rng.normal(0, 1e-11, len(self.clock_time))
        self.drift = drift
        self.board_time = np.arange(5, 86400, 8)
        self.board_offset_ns = rng.choice(_OFFSETS_NS, len(self.board_time), p=[0.4, 0.25, 0.25, 0.05, 0.05])

    def to_gps(self, board):
        """GPS from on-board time."""
        receiver = board + 1e-9 * np.interp(board, self.board_time, self.board_offset_ns)
        return receiver + np.interp(receiver, self.clock_time, self.clock_offset)

    def to_board(self, gps):
        """On-board from GPS time (to a nanosecond)."""
        board = np.asarray(gps, float)
        for _ in range(4):
            board = board - (self.to_gps(board) - gps)
        return board

    def accelerometer_tags(self, start, stop):
        """Indices and tags (whole microseconds, on-board) of the accelerometer rows between GPS times, with margin."""
        low, high = self.to_board(np.array([start - 30.0, stop + 30.0]))
        k = np.arange(int(low / 0.099991), int(high / 0.099991) + 1)
        return k, np.rint(7739 + 99993.6 * k - 25.6 * (k // 10)).astype(np.int64)

    def torquer_tags(self, start, stop):
        """Tags (whole microseconds, on-board) at .1 and .6 of each second between GPS times, with margin."""
        low, high = self.to_board(np.array([start - 30.0, stop + 30.0]))
        return np.arange(int(low) * 2, int(high) * 2) * 500_000 + 100_000
