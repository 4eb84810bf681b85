# nadird in a container: ./run package, then
#   docker build -f cmake/packaging/docker/nadird.Dockerfile -t nadird build/packages
# Run it with the aircraft's files and devices, without systemd: docs/install.md has the command.
FROM debian:12-slim
COPY nadird_*.deb /tmp/packages/
RUN apt-get update && \
    apt-get install -y --no-install-recommends /tmp/packages/nadird_*.deb && \
    install -d -o nadir -g nadir -m 0700 /var/lib/nadir && \
    rm -rf /tmp/packages /var/lib/apt/lists/*
USER nadir
VOLUME ["/var/lib/nadir", "/var/lib/nadir-flights"]
EXPOSE 8750
ENTRYPOINT ["/usr/bin/nadird", "--state", "/var/lib/nadir"]
