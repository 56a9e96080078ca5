# The project on plain Debian, without a ROS installation: docker build -t known_objects . && docker run --rm known_objects
# Other executables: docker run --rm --network host known_objects recovery_node
FROM debian:bookworm-slim
RUN apt-get update \
    && apt-get install --no-install-recommends --yes ca-certificates make python3 python3-venv \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /opt/known_objects
COPY . .
RUN make setup
ENV PATH=/opt/known_objects/.venv/bin:$PATH
CMD ["make", "demo"]
