# Runs the steps in the guest of tests/board/vimc. The graph's scaler is linked with the debayer of sensor A; the probe is to use sensor B.
say() { echo "RIG $*"; }
times=$(sed 's/.*times=\([0-9]*\).*/\1/' /proc/cmdline)
fail() { say "failed: $*"; cat /tmp/serve.log; exit 1; }
# The graph is wrong at the start: the sensor has another size than the debayer, and its debayer has no link to the scaler.
media-ctl -d /dev/media0 -V '"Sensor B":0[fmt:SGRBG8_1X8/160x120]' || exit 1
media-ctl -d /dev/media0 -l '"Debayer A":1 -> "Scaler":0 [1]' || exit 1
node=$(media-ctl -d /dev/media0 -e "RGB/YUV Capture")
state() { media-ctl -d /dev/media0 -p | grep -E 'entity|<-|->|fmt'; }
state > /tmp/before
grep -A2 'Debayer B' /tmp/before > /dev/null || exit 1

hemilux devices --json > /tmp/devices.json || exit 1
say "sensors $(grep -c '"sensor_name": "Sensor' /tmp/devices.json) cameras $(grep -c '"driver"' /tmp/devices.json)"

# Without links and formats the stream does not start.
v4l2-ctl -d "$node" --set-fmt-video=width=320,height=240,pixelformat=RGB3 --stream-mmap=3 --stream-count=1 2>&1 | grep -q 'Broken pipe' &&
    say "refused while formats disagree"

source="v4l2:$node,sensor=Sensor B,size=320x240,format=RGB3,rate=30,exposures=0.001/0.006/0.036,stand-in=Brightness:48/88/128"
n=0
while [ $n -lt "$times" ]; do
    hemilux serve --source "$source" --listen 127.0.0.1:8080 --open --lights 16 > /tmp/serve.out 2> /tmp/serve.log &
    probe=$!
    tries=0
    until wget -q -O - http://127.0.0.1:8080/lights.json 2> /dev/null | grep -q '"direction"'; do
        kill -0 $probe 2> /dev/null || fail "the probe ended in round $n"
        tries=$((tries + 1))
        [ $tries -gt 600 ] && fail "no lights in round $n"
        sleep 0.2
    done
    state > /tmp/during
    grep -A3 'Debayer B' /tmp/during | grep -q 'fmt:S[A-Z0-9]*_1X[0-9]*/320x240' || fail "the debayer has another format in round $n"
    [ $n = 0 ] && say "lights: $(wget -q -O - http://127.0.0.1:8080/v1/status | tr ',' '\n' | grep -E '"(rate_hz|complete|lost)"' | tr '\n' ' ')"
    kill -TERM $probe
    wait $probe || fail "the probe did not end well in round $n"
    state > /tmp/after
    cmp -s /tmp/before /tmp/after || { diff /tmp/before /tmp/after; fail "links or formats are not as before in round $n"; }
    n=$((n + 1))
done
say "lit $n of $times, links and formats restored"
exit 0
