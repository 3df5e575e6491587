"""Sources of a stream, of which there should be one."""

from collections.abc import Sequence

from tactile_localizer.errors import listed


def describe_sources(topic: str, nodes: Sequence[str] = (), frames: Sequence[str] = ()) -> str:
    """More than one source of a topic, in one line; empty if there is one.

    Parameters
    ----------
    topic : its name
    nodes : one for each publisher, where that is known
    frames : different frames in the headers of its messages
    """
    found = max(len(nodes), len(frames))
    if found < 2:
        return ""
    what = "publisher" if len(nodes) > 1 else "source"
    names = f"frames {listed(frames)}" if len(frames) > 1 else f"nodes {listed(nodes)}"
    return f"expected one {what} of {topic}, found {found} ({names})"
