# What is installed, and the Debian package of it: script/package. `cmake --install` puts the same files under another prefix.
# Only the target cloam need be built: CMake would build every test first.
set(CMAKE_SKIP_INSTALL_ALL_DEPENDENCY ON)
include(GNUInstallDirs)
set(documents ${CMAKE_INSTALL_DATADIR}/doc/cloam)

install(TARGETS cloam)
if(TARGET cloam-mpi)
  install(TARGETS cloam-mpi LIBRARY DESTINATION lib/cloam)
endif()
install(DIRECTORY shipped DESTINATION ${CMAKE_INSTALL_DATADIR}/cloam)
install(FILES README.md CONTRIBUTING.md cmake/copyright DESTINATION ${documents})
install(DIRECTORY docs DESTINATION ${documents})  # messages of the program name its pages

# The program itself knows its man page and its completions.
function(install_words kind place)
  get_filename_component(folder ${place} DIRECTORY)
  set(file ${CMAKE_BINARY_DIR}/${place})
  file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/${folder})
  install(CODE "execute_process(COMMAND \"$<TARGET_FILE:cloam>\" completion ${kind} OUTPUT_FILE \"${file}\"
    COMMAND_ERROR_IS_FATAL ANY)")
  if(kind STREQUAL man)  # -n: the same bytes each time
    install(CODE "execute_process(COMMAND gzip -9nf \"${file}\" COMMAND_ERROR_IS_FATAL ANY)")
    string(APPEND file .gz)
  endif()
  install(FILES ${file} DESTINATION ${folder})
endfunction()
install_words(man ${CMAKE_INSTALL_DATADIR}/man/man1/cloam.1)
install_words(bash ${CMAKE_INSTALL_DATADIR}/bash-completion/completions/cloam)
install_words(zsh ${CMAKE_INSTALL_DATADIR}/zsh/vendor-completions/_cloam)
install_words(fish ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d/cloam.fish)

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_CONTACT "cloam maintainers <maintainers@cloam.invalid>")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
set(CPACK_DEBIAN_PACKAGE_SECTION graphics)
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "3D reconstruction and generation on any OpenCL device")
set(CPACK_DEBIAN_PACKAGE_DESCRIPTION "Photos or driving logs in; scenes out that can be rendered from new places,
edited, and exported: radiance fields (NeRF), Gaussian splats, streets whose
vehicles are assets of their own, and new vehicles that no camera saw.

It needs a driver for OpenCL 1.2, which may be that of a CPU (PoCL).")

# The linked libraries, ocl-icd-libopencl1 among them, by dpkg-shlibdeps. A driver is found when the program runs: PoCL, unless
# another is installed already.
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_DEPENDS "pocl-opencl-icd | opencl-icd")
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS fonts-dejavu-core)
set(CPACK_DEBIAN_PACKAGE_SUGGESTS "colmap, ffmpeg, openmpi-bin")
set(CPACK_INSTALL_CMAKE_PROJECTS ${CMAKE_BINARY_DIR};cloam;Unspecified;/)  # without the library (library.cmake)
include(CPack)
