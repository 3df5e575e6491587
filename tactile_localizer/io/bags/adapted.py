"""Strain in a bag whose messages are of other types, by a strain adapter."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader

from tactile_localizer.errors import MeasurementError, ScanError
from tactile_localizer.io.bags.decode import Strains
from tactile_localizer.io.bags.reader import typestore
from tactile_localizer.io.strain_adapter import StrainAdapter
from tactile_localizer.scene import Scene


def read_adapted(path: str | Path, adapter: StrainAdapter, scene: Scene) -> tuple[Strains, list[str]]:
    """The strain vectors that an adapter makes of a bag's messages, and a note of what could not be used.

    Parameters
    ----------
    path : a bag as :func:`~.reader.read_messages` reads it, undamaged
    adapter : which messages are strain
    scene : names the phalanges that are wanted

    Raises
    ------
    ScanError
        The bag cannot be read, or lacks messages of the first phalanx.
    SceneError
        The adapter lacks a phalanx of the scene, or has it with other channels.
    """
    rows = scene.rows(adapter.phalanges)
    columns = scene.channels(adapter.phalanges, adapter.layout.counts)
    vectors, refused, reason = [], 0, ""
    topics = {f"/{topic.lstrip('/')}": topic for topic in adapter.topics}
    adapter.reset()
    try:
        with AnyReader([Path(path)], default_typestore=typestore()) as reader:
            connections = [
                each
                for each in reader.connections
                if each.topic in topics and adapter.topics[topics[each.topic]] == each.msgtype
            ]
            for connection, received_ns, raw in reader.messages(connections) if connections else ():
                try:
                    message = reader.deserialize(raw, connection.msgtype)
                    vector = adapter.feed(topics[connection.topic], message, received_ns)
                except MeasurementError as error:
                    refused, reason = refused + 1, reason or str(error)
                    continue
                if vector is not None:
                    vectors.append(vector)
    except Exception as error:  # rosbags raises whatever damaged bytes lead to
        text = " ".join(str(error).split()) or type(error).__name__
        raise ScanError(f"{path}: expected a bag that can be read, {text}") from None
    if not vectors:
        first = adapter.sources[0]
        raise ScanError(
            f"{path}: expected messages of {first.topic} ({first.kind}) for phalanx {first.phalanx}, found "
            f"{f'{refused} that cannot be used: {reason}' if refused else 'none'}"
        )
    stamp_ns, strain, status = map(np.array, zip(*vectors, strict=True))
    notes = [f"left out {refused} messages of other form: {reason}"] if refused else []
    fits = np.ones(len(vectors), dtype=bool)
    return Strains(stamp_ns, strain[:, columns], status[:, rows], fits), notes
