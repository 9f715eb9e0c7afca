"""Add the rows of files that lie in the store already to the transaction that records a result."""

from __future__ import annotations

from collections.abc import Iterable

from sqlalchemy.orm import Session

from service.db.models import ArtifactRow
from service.domain.outcome import StoredArtifact


def keep_files(session: Session, files: Iterable[StoredArtifact], **owner: int) -> None:
    """`owner`: the one of design_id, charge_id and diagnosis_id that they belong to."""
    session.add_all(
        ArtifactRow(
            kind=file.kind,
            file_name=file.file_name,
            media_type=file.media_type,
            sha256=file.sha256,
            size_bytes=file.size_bytes,
            path=file.path,
            **owner,
        )
        for file in files
    )
