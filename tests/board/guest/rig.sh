# Runs the steps in the guest. Each step writes its result to the console; the host checks it and writes the next command.
say() { echo "RIG $*"; }
camera=v4l2:/dev/video0,size=640x480,format=YUYV,rate=25
# The guest's clock counts instructions and jumps when the guest is idle, so a loop of lowest priority keeps it busy.
nice -n 19 sh -c 'while :; do :; done' &
mkdir -p /tmp/www
httpd -p 8081 -h /tmp/www
say ready
read -r frames disconnects < /dev/console

# The package, if there is one, is installed with Debian's dpkg, whose database is empty.
if [ -e /hemilux.deb ]; then
    mkdir -p /var/lib/dpkg/info /var/lib/dpkg/updates /var/log
    touch /var/lib/dpkg/status
    # Busybox has the other programs that dpkg requires in the path, or dpkg does not use them.
    PATH=/usr/bin:/bin /usr/bin/dpkg -i --force-depends --force-bad-path /hemilux.deb || exit 1
    [ -s /etc/hemilux/hemilux.conf ] || exit 1
    say installed "$(hemilux --version)"
fi

# Checks the rig itself before the probe runs.
v4l2-compliance -d /dev/video0 -s5 > /tmp/www/compliance.txt
say compliance
hemilux devices --json > /tmp/www/devices.json || exit 1
hemilux devices || exit 1
say devices

# Sets a picture in which every luma byte follows the brightness, and a schedule of three brightness values.
v4l2-ctl -d /dev/video0 --set-ctrl test_pattern=6,osd_text_mode=2
hemilux devices --check "$camera,exposures=0.001/0.006/0.036,stand-in=Brightness:32/80/128" --frames "$frames" --json \
    > /tmp/www/check.json || exit 1
say check

# Records the camera's frames byte for byte.
hemilux record --source "$camera,exposures=0.001/0.006/0.036,stand-in=Brightness:32/80/128" --bursts 4 --out /tmp/rec || exit 1
tar -c -f /tmp/www/rec.tar -C /tmp rec
rm -rf /tmp/rec
say record

v4l2-ctl -d /dev/video0 --set-ctrl test_pattern=0,brightness=128
settings=/var/lib/hemilux/hemilux.toml
mkdir -p /var/lib/hemilux
printf '# By hand: the lamp in the hall.\nlights = 32 # few\n' > $settings
serve() {
    rm -f /tmp/serve.out
    RUST_LOG=info hemilux serve --source "$camera" --listen 0.0.0.0:8080 --open --config $settings 2> /tmp/www/serve.log > /tmp/serve.out &
    probe=$!
    until grep -q serving /tmp/serve.out 2> /dev/null; do
        kill -0 $probe || { cat /tmp/www/serve.log; exit 1; }
        sleep 0.2
    done
}
serve
say serving "$(cat /tmp/serve.out)"
read -r go < /dev/console

held() { echo "fds $(ls /proc/$probe/fd | wc -l) maps $(wc -l < /proc/$probe/maps) threads $(ls /proc/$probe/task | wc -l) $(grep VmRSS /proc/$probe/status | tr -s ' \t' ' ') $(grep VmHWM /proc/$probe/status | tr -s ' \t' ' ')"; }
n=0
while [ $n -lt "$disconnects" ]; do
    # The first recoveries may allocate memory that later recoveries reuse.
    [ $n = 2 ] && say held-before "$(held)"
    v4l2-ctl -d /dev/video0 --set-ctrl disconnect=1 > /dev/null 2>&1
    # vivid stays in use until the probe has closed all file descriptors and mappings.
    tries=0
    until rmmod vivid 2> /dev/null; do
        tries=$((tries + 1))
        [ $tries -gt 100 ] && { say "vivid is still held after disconnect $n"; exit 1; }
        sleep 0.1
    done
    if [ $n = 0 ]; then
        say pulled
        read -r go < /dev/console
    fi
    insmod /lib/m/*-vivid.ko n_devs=1 node_types=0x1 vid_cap_nr=0 num_inputs=1 input_types=0
    say plugged $n
    read -r go < /dev/console
    n=$((n + 1))
done
say held-after "$(held)"
say recovered $n
read -r go < /dev/console

# Upgrades the package beside the running probe, then downgrades it. The edited configuration file and the saved settings stay byte for byte.
if [ -e /hemilux.deb ]; then
    echo '# By hand.' >> /etc/hemilux/hemilux.conf
    before=$(cat /etc/hemilux/hemilux.conf $settings | sha256sum)
    for package in /later.deb /hemilux.deb; do
        PATH=/usr/bin:/bin /usr/bin/dpkg -i --force-depends --force-bad-path --force-confold $package || exit 1
        [ "$(cat /etc/hemilux/hemilux.conf $settings | sha256sum)" = "$before" ] || { say "changed configuration after $package"; exit 1; }
        say replaced "$(/usr/bin/dpkg-query -W -f='${Version}' hemilux)"
        read -r go < /dev/console
        kill -TERM $probe
        wait $probe || exit 1
        serve
        say restarted
        read -r go < /dev/console
    done
fi
kill -TERM $probe
wait $probe
say stopped $?
read -r go < /dev/console
if [ -e /hemilux.deb ]; then
    PATH=/usr/bin:/bin /usr/bin/dpkg -r --force-bad-path hemilux || exit 1
    [ ! -e /usr/bin/hemilux ] || exit 1
    say removed
fi
exit 0
