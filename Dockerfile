# cloam in a container, on the CPU without more ado:
#   docker build -t cloam .
#   docker run --rm -v "$PWD:/data" -v cloam-cache:/cache --user "$(id -u):$(id -g)" cloam doctor
# The folder that you are in is /data, where the program runs; the volume keeps compiled kernels for the next run.
#
# A GPU needs its driver in the image, unless NVIDIA's toolkit brings it, and its devices in the container. Check: cloam doctor.
#   Intel:  docker build -t cloam --build-arg MORE=intel-opencl-icd .
#           docker run --device /dev/dri --group-add "$(getent group render | cut -d: -f3)" ...
#   AMD:    docker build -t cloam --build-arg DEBIAN=trixie --build-arg MORE=mesa-opencl-icd .
#           docker run --device /dev/dri --group-add "$(getent group render | cut -d: -f3)" -e RUSTICL_ENABLE=radeonsi ...
#           Or ROCm: MORE=rocm-opencl-icd, and --device /dev/kfd besides. Debian 12 has no driver for these cards.
#   NVIDIA: with the NVIDIA Container Toolkit on the host, and the host's file that names the driver, which the toolkit may leave out:
#           docker run --gpus all -e NVIDIA_DRIVER_CAPABILITIES=compute,utility \
#             -v /etc/OpenCL/vendors/nvidia.icd:/etc/OpenCL/vendors/nvidia.icd:ro ...
# script/package-test runs both stages without a container; it knows the instructions that stand here and no others.

ARG DEBIAN=bookworm

FROM debian:$DEBIAN-slim AS build
WORKDIR /cloam
COPY . .
RUN script/package

FROM debian:$DEBIAN-slim
ARG MORE=""
ENV XDG_CACHE_HOME=/cache
COPY --from=build /cloam/build/release/cloam_*.deb /tmp/
RUN apt-get update \
    && apt-get install -y --no-install-recommends /tmp/cloam_*.deb pocl-opencl-icd fonts-dejavu-core $MORE \
    && rm -rf /tmp/cloam_*.deb /var/lib/apt/lists/* \
    && mkdir -m 1777 /cache
WORKDIR /data
ENTRYPOINT ["cloam"]
