# docker build -t lajolla . && docker run --rm -v "$PWD:/work" lajolla render scene.xml
FROM debian:12 AS build
RUN apt-get update && apt-get install -y --no-install-recommends \
    g++ libembree-dev libtbb-dev zlib1g-dev python3-dev python3-venv ca-certificates
COPY . /source
RUN python3 -m venv /opt/lajolla && /opt/lajolla/bin/pip install --no-cache-dir "/source[vdb]"

FROM debian:12
RUN apt-get update && apt-get install -y --no-install-recommends libembree3-3 libtbb12 zlib1g python3 \
    && rm -rf /var/lib/apt/lists/*
COPY --from=build /opt/lajolla /opt/lajolla
WORKDIR /work
ENTRYPOINT ["/opt/lajolla/bin/lajolla"]
