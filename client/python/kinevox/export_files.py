"""Writes the chunks of an export to files."""
from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import IO

from kinevox.recordings import ExportPiece

OnProgress = Callable[[float], None]


class ExportFiles:
    """Writes each file under a temporary name and renames it when complete.

    written: the complete files. warnings: one line each. on_progress receives the progress of creating the files on
    the server, 0 to 1.
    """

    def __init__(self, to: Path, on_progress: OnProgress | None = None) -> None:
        self.written: list[Path] = []
        self.warnings: list[str] = []
        self._single = to.suffix != "" and not to.is_dir()
        self._to = to
        self._on_progress = on_progress
        self._file: IO[bytes] | None = None
        self._temporary = to

    def take(self, piece: ExportPiece) -> None:
        """Handles the next message."""
        if not piece.file_name:
            if self._on_progress is not None:
                self._on_progress(piece.progress)
            return
        folder = self._to.parent if self._single else self._to
        # The name comes from the network: use no path in it.
        target = self._to if self._single and not self.written else folder / Path(piece.file_name).name
        if self._file is None:
            folder.mkdir(parents=True, exist_ok=True)
            self._temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
            self._file = open(self._temporary, "wb")
        self._file.write(piece.data)
        if not piece.last_chunk:
            return
        self._file.close()
        self._file = None
        self._temporary.replace(target)
        self.written.append(target)
        if piece.warning:
            self.warnings.append(piece.warning)

    def __enter__(self) -> "ExportFiles":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is not None:
            self._file.close()
            self._temporary.unlink(missing_ok=True)
