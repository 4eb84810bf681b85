# The planner's program in a container: ./run package, then
#   docker build -f cmake/packaging/docker/nadir.Dockerfile -t nadir build/packages
#   docker run --rm -v "$PWD:/work" -u "$(id -u)" nadir cache verify package --trust root.json
FROM debian:12-slim
COPY nadir_*.deb /tmp/packages/
RUN apt-get update && \
    apt-get install -y --no-install-recommends /tmp/packages/nadir_*.deb && \
    rm -rf /tmp/packages /var/lib/apt/lists/*
WORKDIR /work
ENTRYPOINT ["/usr/bin/nadir"]
