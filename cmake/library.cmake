# The library as other programs see it: `cmake --install` puts headers, archives, find_package(cloam) and pkg-config's cloam.pc under
# the prefix, as the component `library`, which the Debian package leaves out. docs/library.md.
include(CMakePackageConfigHelpers)
set(library_headers ${CMAKE_INSTALL_INCLUDEDIR}/cloam-${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
set(library_package ${CMAKE_INSTALL_LIBDIR}/cmake/cloam)
set(floors io scene nn data synth metrics mesh gaussians diffusion train fields render batches splat latents street methods runs eval)

foreach(name runtime ${floors})
  set_target_properties(cloam_${name} PROPERTIES EXPORT_NAME ${name})
  target_include_directories(cloam_${name} INTERFACE $<INSTALL_INTERFACE:${library_headers}>)
  install(TARGETS cloam_${name} EXPORT cloam COMPONENT library)
endforeach()
target_compile_features(cloam_runtime INTERFACE cxx_std_20)
set_target_properties(cloam_models PROPERTIES EXPORT_NAME models)
install(TARGETS cloam_models cloam_flags EXPORT cloam COMPONENT library)
install(DIRECTORY runtime models DESTINATION ${library_headers} COMPONENT library FILES_MATCHING PATTERN *.h)

set(generated ${CMAKE_BINARY_DIR}/generated)
configure_file(cmake/version.h.in ${generated}/version.h @ONLY)
install(FILES ${generated}/version.h DESTINATION ${library_headers}/cloam COMPONENT library)

install(EXPORT cloam NAMESPACE cloam:: DESTINATION ${library_package} FILE cloam-targets.cmake COMPONENT library)
configure_package_config_file(cmake/cloam-config.cmake.in ${generated}/cloam-config.cmake INSTALL_DESTINATION ${library_package})
write_basic_package_version_file(${generated}/cloam-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${generated}/cloam-config.cmake ${generated}/cloam-config-version.cmake cmake/FindOpenImageIO.cmake
  DESTINATION ${library_package} COMPONENT library)

# Archives in the order in which a linker needs them: what uses others comes first.
set(archives runtime ${floors})
list(REVERSE archives)
list(TRANSFORM archives PREPEND -lcloam_)
list(JOIN archives " " archives)
file(RELATIVE_PATH headers_from_here /${CMAKE_INSTALL_LIBDIR}/pkgconfig /${library_headers})
configure_file(cmake/cloam.pc.in ${generated}/cloam.pc @ONLY)
install(FILES ${generated}/cloam.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT library)
