#!/bin/sh
# The picture of a report for the documentation: its page as a headless browser shows it,
#     tools/report_picture.sh build/demo/report.html docs/images/report.png
set -eu

page=$(realpath "$1")
for browser in chromium chromium-browser google-chrome; do
    command -v "$browser" >/dev/null && break
done
"$browser" --headless --no-sandbox --disable-gpu --hide-scrollbars --force-device-scale-factor=1 \
    --window-size=1180,2050 --virtual-time-budget=5000 --screenshot="$2" "file://$page" 2>/dev/null
echo "$2"
