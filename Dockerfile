# cloam in a container, on the CPU without more ado:
#   docker build -t cloam .
#   docker run --rm -v "$PWD:/data" -v cloam-cache:/cache --user "$(id -u):$(id -g)" cloam doctor
# The folder that you are in is /data, where the program runs; the volume keeps compiled kernels for the next run.
#
# A GPU needs its driver in the image, unless NVIDIA's toolkit brings it, and its devices in the container. Check: cloam doctor.
#   Intel:  docker build -t cloam --build-arg MORE=intel-opencl-icd .
#           docker run --device /dev/dri --group-add "$(getent group render | cut -d: -f3)" ...
#   AMD:    not yet. Debian 12 has no driver for these cards: docs/how-to/gpu-drivers.md. With AMD's own packages of ROCm in the image,
#           the devices are --device /dev/dri --device /dev/kfd.
#   NVIDIA: with the NVIDIA Container Toolkit on the host, and the host's file that names the driver, which the toolkit may leave out:
#           docker run --gpus all -e NVIDIA_DRIVER_CAPABILITIES=compute,utility \
#             -v /etc/OpenCL/vendors/nvidia.icd:/etc/OpenCL/vendors/nvidia.icd:ro ...
# script/package-test runs both stages without a container; it knows the instructions that stand here and no others.

FROM debian:bookworm-slim AS build
WORKDIR /cloam
COPY . .
RUN script/package

FROM debian:bookworm-slim
ARG MORE=""
ENV XDG_CACHE_HOME=/cache
COPY --from=build /cloam/build/release/cloam_*.deb /tmp/
RUN apt-get update \
    && apt-get install -y --no-install-recommends /tmp/cloam_*.deb pocl-opencl-icd fonts-dejavu-core $MORE \
    && rm -rf /tmp/cloam_*.deb /var/lib/apt/lists/* \
    && mkdir -m 1777 /cache
WORKDIR /data
ENTRYPOINT ["cloam"]
