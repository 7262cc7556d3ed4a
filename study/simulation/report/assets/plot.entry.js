// The parts of Observable Plot and D3 that the explorer uses. For another version or more parts, make plot.min.js again with
//     npm install @observablehq/plot@0.6.17 d3@7.9.2 esbuild@0.28.2
//     npx esbuild plot.entry.js --bundle --minify --format=iife --global-name=Plot --target=es2020 --outfile=plot.min.js
export { plot, dot, line, link, text, ruleY, tip, pointer } from "@observablehq/plot";
export { quantize, interpolateViridis, symbol } from "d3";
