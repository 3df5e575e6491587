# The environment of this checkout, to be sourced by bash: ROS 2, the virtual environment, the built workspace.
#
#   . scripts/env.sh                   ROS 2 Jazzy from PyPI wheels, or the ROS 2 that is sourced already
#   ROS_DISTRO=kilted . scripts/env.sh the wheels of another distribution
#
# Sets TACTILE_ROOT, TACTILE_FLAVOR (jazzy, kilted: wheels; system: a sourced ROS 2), TACTILE_VENV and
# TACTILE_SUFFIX (of build/, install/ and log/). Safe to source twice and under `set -euo pipefail`.

TACTILE_ROOT=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

_tactile_system_ros() { # a sourced ROS 2 whose rclpy the system's python3 finds, and not our own wheels
    [[ -n ${AMENT_PREFIX_PATH-} && ${TACTILE_FLAVOR-system} == system ]] &&
        python3 -c 'import importlib.util as u; raise SystemExit(u.find_spec("rclpy") is None)' 2>/dev/null
}

if _tactile_system_ros; then
    TACTILE_FLAVOR=system
else
    TACTILE_FLAVOR=${ROS_DISTRO:-jazzy}
fi
TACTILE_SUFFIX=-$TACTILE_FLAVOR
[[ $TACTILE_FLAVOR == jazzy ]] && TACTILE_SUFFIX=
TACTILE_VENV=$TACTILE_ROOT/.venv$TACTILE_SUFFIX
export TACTILE_ROOT TACTILE_FLAVOR TACTILE_SUFFIX TACTILE_VENV

if [[ $TACTILE_FLAVOR != system ]]; then # the venv is the ROS prefix; a sourced ROS 2 that python3 cannot use is left
    [[ -z ${AMENT_PREFIX_PATH-} || $AMENT_PREFIX_PATH == *"$TACTILE_VENV"* ]] || unset LD_LIBRARY_PATH
    export ROS_DISTRO=$TACTILE_FLAVOR ROS_VERSION=2 ROS_PYTHON_VERSION=3
    export AMENT_PREFIX_PATH=$TACTILE_VENV CMAKE_PREFIX_PATH=$TACTILE_VENV
    unset PYTHONPATH PYTHONHOME
fi

export VIRTUAL_ENV=$TACTILE_VENV
[[ $PATH == "$TACTILE_VENV/bin:"* ]] || export PATH=$TACTILE_VENV/bin:$PATH

if [[ -f $TACTILE_ROOT/install$TACTILE_SUFFIX/local_setup.bash ]]; then
    _tactile_options=$-
    set +eu # colcon's scripts read unset variables
    . "$TACTILE_ROOT/install$TACTILE_SUFFIX/local_setup.bash"
    [[ $_tactile_options != *e* ]] || set -e
    [[ $_tactile_options != *u* ]] || set -u
    unset _tactile_options
fi
unset -f _tactile_system_ros
