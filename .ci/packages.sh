# Every Debian 12 package that is needed, and why. Sourced by ./run.

packages_build=(
  build-essential            # gcc 12, make, libc headers
  cmake                      # the build system
  ninja-build                # the build tool that cmake drives
  ccache                     # a second build compiles only what changed
  mold                       # links the tests
  pkg-config                 # finds WebP, exiv2, zstd
  libfmt-dev                 # text formatting (gcc 12 has no std::format)
  libcli11-dev               # command line parsing
  nlohmann-json3-dev         # JSON
  libyaml-cpp-dev            # missions and cameras, with line numbers
  libcsv-dev                 # telemetry and truth tables
  libssl-dev                 # SHA-256, Ed25519
  libsqlite3-dev             # MBTiles
  libjpeg-dev                # JPEG, decoded at the scale that is needed
  libpng-dev                 # PNG
  libwebp-dev                # WebP tiles
  libtiff-dev                # COG without GDAL, frames
  libexiv2-dev               # EXIF and XMP of photos, for imports of flights
  libeigen3-dev              # linear algebra
  libceres-dev               # block adjustment; brings glog and SuiteSparse
  libopencv-core-dev         # matrices, DFT; the module packages alone, because libopencv-dev
  libopencv-imgproc-dev      #   drags in VTK and Qt
  libopencv-features2d-dev   # odometry's features
  libopencv-calib3d-dev      # robust geometry
  libopencv-flann-dev        # needed by features2d
  libfaiss-dev               # the place index's vectors
  libflatbuffers-dev         # the flight recorder's payloads
  flatbuffers-compiler       # its schemas, at build time
  libzstd-dev                # its chunks
  liblz4-dev                 # chunks of other people's MCAP files
  zlib1g-dev                 # CRC-32
  librsync-dev               # patches of packages
  libp11-kit-dev             # keys in tokens, by PKCS#11
  libgeographiclib-dev       # grid references (MGRS); the tests' oracle for local frames
  libboost-dev               # Beast, Asio: the HTTP of nadird; headers alone, libgdal-dev brings them anyway
  libcurl4-openssl-dev       # `nadir sync`; libgdal-dev takes it in the place of the one with GnuTLS
  libgdal-dev                # reads the planner's rasters; never linked by nadird
  libjs-leaflet              # the map of the desk's page, embedded at build by the digest of its files
  libproj-dev                # coordinate systems of those rasters, and the tests' oracle
  python3                    # generates the MAVLink headers
  python3-venv               # the environment that the generator lives in (.ci/python.sh)
  libgtest-dev               # tests
  libgmock-dev               # tests
)
packages_demo=(
  gdal-bin                   # gdalinfo, gdal_translate: independent readers and the bench's baseline
  openssl                    # the tests' oracle for digests and signatures
  sqlite3                    # the tests' oracle for MBTiles
  python3                    # the tests' oracles and the scoring of results
  python3-jsonschema         # the tests' judge of what schemas/ says
  binutils                   # readelf: what nadird links
)
packages_fuzz=(
  clang-19                   # libFuzzer
  libclang-rt-19-dev         # its runtime, and the sanitizers'
  libomp-19-dev              # OpenMP for what is built with clang
)
packages_test=(
  curl                       # the desk's API as docs/put-photos-on-the-map.md calls it
  gstreamer1.0-plugins-base  # the test camera of the GStreamer plug-in
  libgstreamer1.0-dev        # that plug-in, which is built where this is installed
  libsqlite3-mod-spatialite  # sqlite3 judges the catalogue's geometries
  chromium-headless-shell    # the pages in a real browser, without the windows that people have around them
  postgresql-15              # a real server, which the tests of the catalogue start and stop
  postgresql-15-postgis-3    # its geometries
  age                        # encrypts packages, as docs/secrecy.md says
  fsverity                   # the digests of imagery, by the kernel's own tool
  softhsm2                   # a PKCS#11 token in software
  opensc                     # pkcs11-tool, which makes keys in it
  slurmctld                  # a real scheduler, which a test of shared builds starts and stops ...
  slurmd                     # ... with two nodes ...
  slurm-client               # ... and jobs that it submits
  munge                      # how they know each other
)
packages_package=(
  libgstreamer1.0-dev        # the camera plug-ins: GStreamer's …
  libopencv-videoio-dev      # … and OpenCV's
  dpkg-dev                   # dpkg-shlibdeps: what a package depends on
  file                       # CPack tells programs from other files by it
  lintian                    # Debian's own judge of packages
  mmdebstrap                 # a fresh Debian 12, in which --check installs them
  buildah                    # … and in which it builds the images by their Dockerfiles
)
packages_amd64=(             # whatever is built there: Debian has them for no other
  libipsec-mb-dev            # SHA-256 of many blocks at once, in the lanes of the processor's vectors
)
packages_arm64=(
  g++-aarch64-linux-gnu      # the cross compiler, Debian's gcc 12 as well
  qemu-user                  # runs what it compiles; counts instructions (the static one takes no plug-ins)
  mmdebstrap                 # unpacks Debian's arm64 libraries (.ci/sysroot.sh)
  dpkg-dev                   # dpkg-shlibdeps
)
packages_lint=(
  clang-format               # .clang-format
  clang-tidy-19              # 14 cannot parse libstdc++ 12's range views
)

# apt ARGUMENTS…: apt-get, which waits up to ten minutes while another package manager works (a machine that has just been
# started often upgrades itself). apt-get itself waits for dpkg's lock, but not for the one on the package lists.
apt() {
  local log waited=0
  until log=$("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq -o DPkg::Lock::Timeout=600 "$@" </dev/null 2>&1); do
    if [[ $log != *"Could not get lock"* || $waited -ge 600 ]]; then
      printf '%s\nrun: apt-get %s failed\n' "$log" "$1" >&2
      exit 2
    fi
    [[ $waited -gt 0 ]] || echo "run: another package manager is running; waiting for it" >&2
    sleep 5
    waited=$((waited + 5))
  done
}

# need_packages GROUP…: installs what is missing, or names it and ends with 2.
need_packages() {
  local group missing=() package
  command -v dpkg-query >/dev/null || {
    echo "run: this is no Debian machine; see .ci/packages.sh for what is needed" >&2; return 0; }
  [[ $(dpkg --print-architecture) != amd64 ]] || set -- "$@" amd64
  for group in "$@"; do
    local -n list="packages_$group"
    for package in "${list[@]}"; do
      [[ $(dpkg-query -W -f='${Status}' "$package" 2>/dev/null) == "install ok installed" ]] && continue
      # A virtual package (libjpeg-dev) is there when something provides it.
      dpkg-query -W -f='${Provides} ${Status}\n' 2>/dev/null | grep -E "(^|[ ,])$package( |,|$).*install ok installed" >/dev/null && continue
      missing+=("$package")
    done
  done
  [[ ${#missing[@]} -eq 0 ]] && return 0
  if [[ ${NADIR_NO_INSTALL:-0} == 1 ]]; then
    echo "run: these Debian packages are missing (NADIR_NO_INSTALL=1, so nothing is installed):" >&2
    printf '  %s\n' "${missing[@]}" >&2
    echo "  to do: apt-get install --no-install-recommends ${missing[*]}" >&2
    exit 2
  fi
  local as_root=()
  if [[ $(id -u) != 0 ]]; then
    command -v sudo >/dev/null || { echo "run: missing packages and no sudo to install them: ${missing[*]}" >&2; exit 2; }
    as_root=(sudo)
  fi
  echo "run: installing ${#missing[@]} Debian packages: ${missing[*]}" >&2
  apt update
  apt install -y --no-install-recommends "${missing[@]}"
}
