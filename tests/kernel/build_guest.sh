#!/usr/bin/env bash
# Builds the guest of the kernel lab, or finds it in the cache, and prints its folder:
#   root.img  an ext4 image with systemd, udev and the modules below
#   vmlinuz, initrd.gz, libraries.txt (what the image has, so that programs bring only the rest)
# Everything comes from Debian packages. gpio-sim, vimc and v4l2loopback are not in Debian's kernel, and are built
# here from linux-source and v4l2loopback-dkms.
#   build_guest.sh CACHE_FOLDER
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
cache=${1:?usage: build_guest.sh CACHE_FOLDER}

say() { echo "   guest: $*" >&2; }
die() { echo "error: the kernel lab's guest cannot be built: $*" >&2; exit 2; }

. /etc/os-release
[ "${VERSION_CODENAME:-}" = bookworm ] || die "it is a Debian 12 guest on a Debian 12 host; this is ${PRETTY_NAME:-unknown}"
[ "$(uname -m)" = x86_64 ] || die "it is an amd64 guest; this machine is $(uname -m)"
as_root=()
[ "$(id -u)" -eq 0 ] || as_root=(sudo)
qemu=$(qemu-system-x86_64 --version | head -n 1)
key=$(cat "$here"/build_guest.sh "$here"/guest/* | sha256sum | cut -c 1-12)

# The kernel is the one that the installed headers belong to.
choose_kernel() {
  local headers
  headers=$(dpkg-query -W -f='${Depends}' linux-headers-amd64 2>/dev/null | grep -o 'linux-headers-[0-9][^ ]*' | head -n 1) ||
    die "linux-headers-amd64 is not installed"
  kernel=${headers#linux-headers-}
  kernel_version=$(dpkg-query -W -f='${Version}' "$headers")
  name=guest-$kernel-$(echo "$kernel_version $qemu $key" | sha256sum | cut -c 1-12)
}

# An archive keeps the newest kernel only: headers installed long ago have none any more.
renew_headers() {
  "${as_root[@]}" apt-get -q update
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q install -y --no-install-recommends linux-headers-amd64
}

choose_kernel
mkdir -p "$cache"
if [ -e "$cache/$name/complete" ]; then
  echo "$cache/$name"
  exit 0
fi

work=$(mktemp -d "$cache/build.XXXXXX")
trap '"${as_root[@]}" rm -rf --one-file-system "$work"' EXIT
log=$work/log
# Runs a step quietly; what it said is shown when it fails.
step() {
  local what=$1
  shift
  say "$what"
  "$@" >"$log" 2>&1 || { tail -n 15 "$log" >&2; die "$what failed"; }
}

# The host's own Debian archives, whatever mirror they are.
archives() {
  apt-get indextargets --format '$(ORIGIN)|deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] $(REPO_URI) $(RELEASE) $(COMPONENT)' \
    'Created-By: Packages' | grep '^Debian|' | cut -d '|' -f 2 | sort -u
}

fetch() {
  (cd "$work" && apt-get -q -o Acquire::Retries=3 download "linux-image-$kernel=$kernel_version" "linux-source-6.1=$kernel_version" v4l2loopback-dkms)
  for package in "$work"/*.deb; do
    dpkg-deb -x "$package" "$work/packages"
  done
}

# One module of gpio-sim and the interrupt simulator that Debian leaves out of its kernel.
build_modules() {
  local tree=linux-source-6.1 build=$work/modules
  mkdir -p "$build"
  tar -C "$work" -xJf "$work/packages/usr/src/$tree.tar.xz" "$tree/drivers/gpio" "$tree/kernel/irq/irq_sim.c" \
    "$tree/drivers/media/test-drivers/vimc"
  mkdir -p "$build/gpio-sim" "$build/vimc" "$build/v4l2loopback"
  cp "$work/$tree/drivers/gpio/gpiolib.h" "$build/gpio-sim/"
  # Kernel 6.1 frees a removed chip's interrupts while programs still wait for edges, and crashes at random later: here
  # the simulated ones of a removed chip stay.
  sed -e 's/devm_irq_domain_create_sim(dev, swnode, num_lines)/irq_domain_create_sim(NULL, num_lines)/' \
    -e 's/irq_dispose_mapping(irq_find_mapping(chip->irq_sim, i))/(void)chip/' \
    "$work/$tree/drivers/gpio/gpio-sim.c" >"$build/gpio-sim/gpio-sim-core.c"
  [ "$(grep -c -e ' irq_domain_create_sim(NULL' -e '(void)chip;' "$build/gpio-sim/gpio-sim-core.c")" -eq 2 ]
  # irq_to_desc() is not exported; generic_handle_irq_safe() does the same from any context.
  sed -e 's/handle_simple_irq(irq_to_desc(\([a-z_]*\)))/generic_handle_irq_safe(\1)/' \
    "$work/$tree/kernel/irq/irq_sim.c" >"$build/gpio-sim/irq_sim.c"
  ! grep -q 'irq_to_desc' "$build/gpio-sim/irq_sim.c"
  printf 'obj-m := gpio-sim.o\ngpio-sim-y := gpio-sim-core.o irq_sim.o\n' >"$build/gpio-sim/Makefile"
  cp "$work/$tree"/drivers/media/test-drivers/vimc/* "$build/vimc/"
  sed -i 's/obj-$(CONFIG_VIDEO_VIMC)/obj-m/' "$build/vimc/Makefile"
  cp "$work/packages/usr/src"/v4l2loopback-*/{v4l2loopback.c,v4l2loopback.h,v4l2loopback_formats.h} "$build/v4l2loopback/"
  echo 'obj-m := v4l2loopback.o' >"$build/v4l2loopback/Makefile"
  for module in gpio-sim vimc v4l2loopback; do
    make -C "/usr/src/linux-headers-$kernel" M="$build/$module" modules
    install -D -m 644 "$build/$module/$module.ko" "$work/packages/lib/modules/$kernel/extra/$module.ko"
  done
  /sbin/depmod -b "$work/packages" "$kernel"
}

wanted_modules=(virtio_pci virtio_blk virtio_net ext4 crc32c_generic autofs4 gpio-sim vimc v4l2loopback vivid uvcvideo vhci-hcd softdog)

bootstrap() {
  archives >"$work/sources.list"
  [ -s "$work/sources.list" ] || { echo "apt knows no Debian archive"; return 1; }
  "${as_root[@]}" mmdebstrap --variant=minbase --aptopt='APT::Install-Recommends "false"' --aptopt='Acquire::Retries "3"' \
    --include=systemd,systemd-sysv,udev,kmod,iproute2,procps,socat,gpiod,libcamera-ipa,libcamera-tools,v4l-utils \
    bookworm "$work/root" "$work/sources.list"
}

furnish() {
  local root=$work/root module file
  for module in "${wanted_modules[@]}"; do
    /sbin/modprobe -d "$work/packages" -S "$kernel" --show-depends "$module" | awk '$1 == "insmod" { print $2 }'
  done | sort -u >"$work/module.list"
  while read -r file; do
    "${as_root[@]}" install -D -m 644 "$file" "$root/${file#"$work"/packages/}"
  done <"$work/module.list"
  "${as_root[@]}" cp "$work/packages/lib/modules/$kernel"/modules.{builtin,builtin.modinfo,order} "$root/lib/modules/$kernel/"
  "${as_root[@]}" /sbin/depmod -b "$root" "$kernel"
  "${as_root[@]}" mkdir -p "$root/etc/systemd/system/multi-user.target.wants" "$root/lab"
  "${as_root[@]}" install -m 755 "$here/guest/lab-agent" "$root/usr/local/bin/"
  "${as_root[@]}" install -m 644 "$here/guest/lab-agent.service" "$root/etc/systemd/system/"
  "${as_root[@]}" ln -s ../lab-agent.service "$root/etc/systemd/system/multi-user.target.wants/"
  for unit in getty.target apt-daily.timer apt-daily-upgrade.timer dpkg-db-backup.timer e2scrub_all.timer \
    e2scrub_reap.service fstrim.timer systemd-update-utmp.service; do
    "${as_root[@]}" ln -sf /dev/null "$root/etc/systemd/system/$unit"
  done
  echo lab | "${as_root[@]}" tee "$root/etc/hostname" >/dev/null
  "${as_root[@]}" rm -rf "$root/var/cache/apt" "$root/var/lib/apt/lists" "$root/usr/share/doc" "$root/usr/share/locale" \
    "$root/usr/share/man"
  mkdir -p "$work/out"
  (cd "$root" && find usr/lib lib -name '*.so*' -printf '%f\n' | sort -u) >"$work/out/libraries.txt"
}

make_initrd() {
  local dir=$work/initrd
  mkdir -p "$dir"/{bin,dev,proc,sys,mnt,lib}
  cp /bin/busybox "$dir/bin/"
  for tool in sh mount insmod switch_root mkdir sleep; do ln -s busybox "$dir/bin/$tool"; done
  for module in virtio_pci virtio_blk crc32c_generic ext4; do
    /sbin/modprobe -d "$work/packages" -S "$kernel" --show-depends "$module" | awk '$1 == "insmod" { print $2 }'
  done | awk '!seen[$0]++' | while read -r file; do
    cp "$file" "$dir/lib/"
    basename "$file" >>"$dir/modules"
  done
  install -m 755 "$here/guest/init" "$dir/init"
  (cd "$dir" && find . | cpio -o -H newc) | gzip -1 >"$work/out/initrd.gz"
  cp "$work/packages/boot/vmlinuz-$kernel" "$work/out/vmlinuz"
}

make_image() {
  local size
  size=$(($("${as_root[@]}" du -sm "$work/root" | cut -f 1) + 300))
  "${as_root[@]}" /sbin/mke2fs -q -t ext4 -O ^has_journal -L lab -d "$work/root" "$work/out/root.img" "${size}M"
  "${as_root[@]}" chown "$(id -u):$(id -g)" "$work/out/root.img"
}

apt-cache show "linux-image-$kernel=$kernel_version" >/dev/null 2>&1 || {
  step "the archive does not know the kernel of the installed headers: renewing lists and headers" renew_headers
  choose_kernel
}
step "fetching the kernel $kernel ($kernel_version), its source and v4l2loopback" fetch
step "building gpio-sim, vimc and v4l2loopback" build_modules
step "installing Debian 12 with mmdebstrap" bootstrap
step "modules and services" furnish
step "initial ramdisk" make_initrd
step "disk image" make_image
touch "$work/out/complete"
rm -rf "${cache:?}/$name"
mv "$work/out" "$cache/$name"
echo "$cache/$name"
