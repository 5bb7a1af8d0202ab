#!/bin/sh
# display.sh COMMAND...: runs the command on a display of its own.
set -eu
Xvfb :91 -screen 0 1400x900x24 +extension GLX >/volillum/display.log 2>&1 &
display=$!
trap 'kill $display' EXIT
tries=0
while [ ! -e /tmp/.X11-unix/X91 ]; do
    tries=$((tries + 1))
    [ $tries -lt 300 ] || { echo "the display does not start" >&2; exit 1; }
    sleep 0.1
done
DISPLAY=:91 "$@"
