"""Where a robot hand is on a piece of flexible material, by touch alone.

Layers, lowest first: :mod:`~tactile_localizer.core` (numpy and scipy only), then
:mod:`~tactile_localizer.io` (files and CAN), :mod:`~tactile_localizer.sim` and
:mod:`~tactile_localizer.evaluation`, then :mod:`~tactile_localizer.nodes` (the only layer that
imports rclpy) and :mod:`~tactile_localizer.cli`. No layer imports one that comes after it.
"""

from pkgutil import extend_path

# The generated messages (tactile_localizer.msg) live in the installed package; without this, a source
# tree on sys.path would hide them.
__path__ = extend_path(__path__, __name__)

__version__ = "0.1.0"
