// The parts of three.js that the viewer uses. For another version or more parts, make three.min.js again with
//     npm install three@0.187.0 esbuild@0.28.2
//     npx esbuild three.entry.js --bundle --minify --format=iife --global-name=THREE --target=es2020 --outfile=three.min.js
export {
    AmbientLight, Color, ConeGeometry, CylinderGeometry, DirectionalLight, DoubleSide, Group, HemisphereLight,
    InstancedMesh, LineBasicMaterial, LineSegments, BufferGeometry, BufferAttribute, Matrix4, Mesh, MeshBasicMaterial,
    MeshLambertMaterial, PerspectiveCamera, Quaternion, Scene, SphereGeometry, Vector3, WebGLRenderer, REVISION,
} from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
