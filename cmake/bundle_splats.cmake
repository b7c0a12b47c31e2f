# Makes OUT of FROM/splats.js and the packages that FROM/package-lock.json pins. Where npm cannot, a warning, and no OUT.
cmake_minimum_required(VERSION 3.24)
get_filename_component(folder ${OUT} DIRECTORY)
file(REMOVE ${OUT})
file(COPY ${FROM}/package.json ${FROM}/package-lock.json ${FROM}/splats.js DESTINATION ${folder})
execute_process(COMMAND ${NPM} ci --ignore-scripts --no-audit --no-fund --fetch-retries=1 --fetch-timeout=20000
  WORKING_DIRECTORY ${folder} RESULT_VARIABLE code OUTPUT_VARIABLE words ERROR_VARIABLE words)
if(code EQUAL 0)
  execute_process(COMMAND ${NPM} run --silent build -- --outfile=${OUT}
    WORKING_DIRECTORY ${folder} RESULT_VARIABLE code OUTPUT_VARIABLE words ERROR_VARIABLE words)
endif()
if(NOT code EQUAL 0)
  file(REMOVE ${OUT})
  message("${words}")
  message("warning: npm could not bundle the viewer's renderer of Gaussians (above). cloam view works without it: the program "
    "draws them in its place. The next build tries again.")
endif()
