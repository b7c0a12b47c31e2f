# The viewer's page, one HTML file that cli/view_page.cpp takes into the program. Two parts: web/src is plain JavaScript, joined by
# CMake alone; web/splats.js (three.js and Spark) is bundled with npm. Without npm, or without a network, the page has no
# second part, and the program draws Gaussians in its place. npm is tried again at the next build.
set(viewer_page ${CMAKE_BINARY_DIR}/generated/viewer.html)
set(viewer_splats ${CMAKE_BINARY_DIR}/web/splats.bundle.js)
find_program(CLOAM_NPM npm DOC "bundles the viewer's renderer of Gaussians")

if(CLOAM_NPM)
  set(web ${CMAKE_SOURCE_DIR}/web)
  add_custom_command(OUTPUT ${viewer_splats}
    COMMAND ${CMAKE_COMMAND} -DNPM=${CLOAM_NPM} -DFROM=${web} -DOUT=${viewer_splats} -P ${CMAKE_SOURCE_DIR}/cmake/bundle_splats.cmake
    DEPENDS ${web}/splats.js ${web}/package.json ${web}/package-lock.json ${CMAKE_SOURCE_DIR}/cmake/bundle_splats.cmake
    COMMENT "Bundling three.js and Spark for cloam view" VERBATIM)
  set(bundled ${viewer_splats})
else()
  message(STATUS "npm was not found: the page of cloam view has no renderer of Gaussians of its own; the program draws them")
endif()

file(GLOB viewer_sources CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/web/src/*.js)
add_custom_command(OUTPUT ${viewer_page}
  COMMAND ${CMAKE_COMMAND} -DFROM=${CMAKE_SOURCE_DIR}/web -DSPLATS=${bundled} -DOUT=${viewer_page}
    -P ${CMAKE_SOURCE_DIR}/cmake/join_page.cmake
  DEPENDS ${viewer_sources} ${CMAKE_SOURCE_DIR}/web/page.html ${CMAKE_SOURCE_DIR}/web/style.css ${bundled}
    ${CMAKE_SOURCE_DIR}/cmake/join_page.cmake VERBATIM)
add_custom_target(viewer_page DEPENDS ${viewer_page})

set_source_files_properties(cli/view_page.cpp PROPERTIES
  COMPILE_DEFINITIONS CLOAM_VIEWER_PAGE="${viewer_page}" OBJECT_DEPENDS ${viewer_page})
