"""Videos that OpenCV's own decoder does not know (AV1), through PyAV; the few methods of cv2.VideoCapture used here."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np


class AvCapture:
    """Frames of a video, upright, one after the other. Raises OSError or ValueError when it cannot be opened."""

    def __init__(self, path: Path) -> None:
        import av  # here, because most videos do without

        self.container = av.open(str(path))
        if not self.container.streams.video:
            self.container.close()
            raise ValueError("it holds no video stream")
        self.stream = self.container.streams.video[0]
        if self.stream.codec_context is None:
            self.container.close()
            raise ValueError("its codec is not known")
        self.errors = (av.FFmpegError, EOFError)
        self.frames: Iterator[Any] = self.container.decode(self.stream)
        self.frame: Any = None

    def grab(self) -> bool:
        """Whether there is a next frame, which `retrieve` then gives."""
        try:
            self.frame = next(self.frames, None)
        except self.errors:  # cut off: what came before counts
            self.frame = None
        return self.frame is not None

    def retrieve(self) -> tuple[bool, np.ndarray]:
        """True and the frame (H, W, 3) uint8, BGR."""
        image = self.frame.to_ndarray(format="bgr24")
        return True, np.ascontiguousarray(np.rot90(image, round(self.frame.rotation / 90)))

    def get(self, what: int) -> float:
        """Width and height in pixels, and the number of frames; 0 for what the file does not promise."""
        known = {
            cv2.CAP_PROP_FRAME_COUNT: self.stream.frames,
            cv2.CAP_PROP_FRAME_WIDTH: self.stream.width,
            cv2.CAP_PROP_FRAME_HEIGHT: self.stream.height,
        }
        return float(known.get(what, 0))

    def release(self) -> None:
        """Close the file."""
        self.container.close()
