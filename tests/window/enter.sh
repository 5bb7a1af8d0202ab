#!/bin/sh
# enter.sh SYSTEM WORK "FOLDER ..." COMMAND...: runs the command inside the system, where WORK is
# /volillum and each FOLDER has its own name. In namespaces of its own: without a network, and
# nothing of it, no mount and no process, outlives the command.
set -eu
# shellcheck disable=SC2016  # the inner shell's own variables
exec unshare --mount --net --pid --fork --kill-child sh -euc '
    system=$1 work=$2 folders=$3
    shift 3
    mount --rbind /dev "$system/dev"
    mount -t proc proc "$system/proc"
    mkdir -p "$system/volillum"
    mount --bind "$work" "$system/volillum"
    for folder in $folders; do
        mkdir -p "$system$folder"
        mount --bind "$folder" "$system$folder"
    done
    rm -rf "$system/tmp/.X11-unix" "$system"/tmp/.X*-lock
    export PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/volillum/home BLENDER_USER_RESOURCES=/volillum/user
    export LIBGL_ALWAYS_SOFTWARE=1
    cd /
    exec chroot "$system" "$@"
' sh "$@"
